"""What the ground raises: one exception per thing a caller can act on."""


class AeroshellError(Exception):
    """Base of all refusals; the message is one sentence: where, what is, what is allowed."""


class IcdError(AeroshellError):
    """The DBC lacks a message or signal, or carries one that the codec cannot serve."""


class BusError(AeroshellError):
    """A bus address that cannot be opened, or a bus that went away."""


class LoadError(AeroshellError):
    """A load image that must not fly."""


class MissionError(AeroshellError):
    """A mission file or an override that cannot be flown."""


class DesignError(AeroshellError):
    """A gain design that cannot be carried out."""


class FlightError(AeroshellError):
    """A flight that could not be started or carried on."""


class RecordingError(AeroshellError):
    """A recording that cannot be written, or a file that is not one of ours or is damaged."""
