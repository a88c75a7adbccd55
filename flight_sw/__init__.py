"""The flight computer: one pure function over plain records, and the loop that runs it."""
