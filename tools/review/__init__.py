"""What an entry engineer looks at, in Rerun: the review of recorded flights, and the live view."""
