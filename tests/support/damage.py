"""What a disk, a cable, an editor or another program does to a file, drawn at random."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random


def damaged(content: bytes, random: Random) -> bytes:
    """Return other bytes than these: flipped, changed, cut, inserted, taken away, or lines doubled, swapped, lost."""
    ways = (_flip_bit, _change_byte, _cut, _insert, _take_away, _zero, _double_line, _swap_lines, _lose_line)
    while (other := random.choice(ways)(content, random)) == content:
        pass
    return other


def _flip_bit(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << random.randrange(8)]) + content[place + 1 :]


def _change_byte(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content))
    return content[:place] + random.choice([random.randbytes(1), b"0", b"1", b"9", b" ", b"\n"]) + content[place + 1 :]


def _cut(content: bytes, random: Random) -> bytes:
    return content[: random.randrange(len(content))]


def _insert(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content) + 1)
    return content[:place] + random.choice([random.randbytes(random.randint(1, 20)), b"7", b"\n"]) + content[place:]


def _take_away(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content))
    return content[:place] + content[place + random.choice([1, 2, 8, 100, 4096]) :]


def _zero(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content))
    length = min(random.choice([1, 16, 512]), len(content) - place)
    return content[:place] + bytes(length) + content[place + length :]


def _lines(content: bytes, random: Random) -> tuple[list[bytes], int, int]:
    lines = content.splitlines(keepends=True)
    return lines, random.randrange(len(lines)), random.randrange(len(lines))


def _double_line(content: bytes, random: Random) -> bytes:
    lines, one, other = _lines(content, random)
    return b"".join([*lines[:one], lines[other], *lines[one:]])


def _swap_lines(content: bytes, random: Random) -> bytes:
    lines, one, other = _lines(content, random)
    lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def _lose_line(content: bytes, random: Random) -> bytes:
    lines, one, _ = _lines(content, random)
    return b"".join([*lines[:one], *lines[one + 1 :]])
