"""The ground: the `aeroshell` command, gain design, reports."""
