"""What came out of a file or from a command line, as it may stand in a sentence.

One line without characters that would move a terminal's cursor or hide what is there, and never
endless.
"""

ECHO_MAX = 200  # characters
DIGITS_MAX = 100
NAME_MAX = 128


def echoed(value: object, longest: int = ECHO_MAX) -> str:
    """A value as text: unprintable characters as their escapes, cut to its beginning if long."""
    if isinstance(value, int) and value.bit_length() > DIGITS_MAX * 4:
        return f"a number of {value.bit_length():,} bits"  # its digits would take for ever
    text = str(value)
    told = text[:longest]
    if not told.isprintable():
        told = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in told)[
            :longest
        ]
    return f"{told}... ({len(text):,} characters)" if len(text) > longest else told


def is_plain_name(name: str) -> bool:
    """Whether a name out of a file is one word of ASCII, as it may stand in a path or a heading."""
    return name.isascii() and name.isidentifier() and len(name) <= NAME_MAX
