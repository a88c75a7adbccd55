"""One flight: the loop, the clock, the bus and its roles, what is logged and measured."""
