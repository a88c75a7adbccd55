"""Numbers as they are stored: to digits below which processors and C libraries differ."""

SIGNIFICANT_DIGITS = 9  # of what is stored of a solved flight or a gain


def rounded(value: float, digits: int = SIGNIFICANT_DIGITS) -> float:
    """The value to the significant digits that are stored."""
    return float(f"{value:z.{digits - 1}e}")
