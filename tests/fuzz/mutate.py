"""Damages files: bytes in, other bytes out, the same for the same seed.

What it does is what goes wrong with files, and what someone would do to them on purpose: bits
flipped, numbers that count or measure replaced by hostile ones, in binary and in text, pieces cut
off, left out, doubled, or taken from another file.
"""

import random
import re
from collections.abc import Callable, Sequence

COUNTS = (
    0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**32,
    2**63 - 9, 2**63 - 1, 2**63, 2**64 - 9, 2**64 - 1,
)  # fmt: skip
"""Where signed, unsigned and narrower readings part, and sums with small numbers overflow."""

NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"-inf", b"NaN", b"Infinity",
    b"null", b"true", b'""', b"[]", b"{}", b"2147483648", b"9223372036854775808",
    b"18446744073709551616", b"9" * 400, b"1" * 5000, b"0.1" * 2, b"0x7fffffffffffffff",
)  # fmt: skip
NAMES = (
    b"../" * 8 + b"x", b"/etc/x", b"a" * 300, b"\x00", b"\x1b[2J\x1b[H", b"\r\n", b"\xef\xbb\xbf",
    b"\xff\xfe", b"\xc0\x80", b"%s%n", b"'\"", b"[" * 2000, b"{" * 2000, b"(" * 500, b"\n" * 50,
)  # fmt: skip
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w.-]*")
PIECE_MAX = 4096  # bytes left out, doubled or taken over at once, mostly
STEPS_MAX = 4

Step = Callable[[bytearray, random.Random, Sequence[bytes]], None]


def mutated(data: bytes, rng: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """A damaged copy; `others` are files that pieces may be taken from."""
    out = bytearray(data)
    for _ in range(rng.randint(1, STEPS_MAX)):
        rng.choice(STEPS)(out, rng, others or (data,))
    return bytes(out)


def _span(data: bytes | bytearray, rng: random.Random) -> slice:
    start = rng.randrange(len(data) + 1)
    longest = len(data) - start if rng.random() < 0.1 else PIECE_MAX
    return slice(start, start + rng.randint(1, max(min(longest, 1 << rng.randint(0, 20)), 1)))


def _flip(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    for _ in range(1 << rng.randint(0, 4)):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)


def _set_count(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    size, at = rng.choice((1, 2, 4, 4, 8, 8)), rng.randrange(len(out) + 1)
    was = int.from_bytes(out[at : at + size], "little")
    count = rng.choice(COUNTS) if rng.random() < 0.7 else was + rng.choice((-1, 1, -9, 9, 256))
    out[at : at + size] = (count % (1 << 8 * size)).to_bytes(size, "little")


def _set_likely_count(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    """Replace eight bytes that look like a length or a count: small, the upper ones zero."""
    for _ in range(64):
        at = rng.randrange(len(out) + 1)
        found = re.compile(rb"[^\x00][\x00-\xff]{0,3}\x00{4,7}").search(out, at, at + 4096)
        if found:
            count = rng.choice(COUNTS)
            out[found.start() : found.start() + 8] = count.to_bytes(8, "little")
            return


def _cut(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    if rng.random() < 0.3:
        del out[rng.randrange(len(out) + 1) :]
    else:
        del out[_span(out, rng)]


def _double(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    piece = bytes(out[_span(out, rng)])
    at = rng.randrange(len(out) + 1)
    out[at:at] = piece * rng.choice((1, 1, 2, 16))


def _splice(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    other = rng.choice(others)
    out[_span(out, rng)] = other[_span(other, rng)]


def _swap_text(pattern: re.Pattern[bytes], values: Sequence[bytes]) -> Step:
    def step(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
        found = pattern.search(out, rng.randrange(len(out) + 1))
        if found:
            out[found.start() : found.end()] = rng.choice(values)

    return step


def _insert(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    at = rng.randrange(len(out) + 1)
    out[at:at] = rng.choice(NAMES + NUMBERS)


def _swap_lines(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    lines = bytes(out).split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    if rng.random() < 0.5:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a:a] = [lines[b]] * rng.choice((1, 2, 100))
    out[:] = b"\n".join(lines)


STEPS: tuple[Step, ...] = (
    _flip,
    _set_count,
    _set_likely_count,
    _cut,
    _double,
    _splice,
    _swap_text(NUMBER, NUMBERS),
    _swap_text(WORD, NAMES),
    _insert,
    _swap_lines,
)
