"""Numbers as they are stored: to digits below which processors and C libraries differ."""

SIGNIFICANT_DIGITS = 9  # of what is stored of a solved flight or a gain


def rounded(value: float) -> float:
    """The value to the digits that are stored."""
    return float(f"{value:z.{SIGNIFICANT_DIGITS - 1}e}")
