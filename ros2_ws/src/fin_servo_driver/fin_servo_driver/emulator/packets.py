"""Dynamixel protocol 2 packets, written from the maker's e-Manual independently of its SDK, which the driver uses."""

from __future__ import annotations

from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
PING, READ, WRITE, STATUS, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x55, 0x82, 0x83
_POLYNOMIAL = 0x8005
_LONGEST_PACKET = 512
"""Bytes; a length beyond it is a broken one, not worth waiting for."""
_LENGTH_AT = 5
_BODY_AT = 7


def crc16(data: bytes) -> int:
    """Return the CRC of protocol 2: polynomial 8005, from 0, most significant bit first."""
    value = 0
    for byte in data:
        value = (value << 8 ^ _CRC_OF[value >> 8 ^ byte]) & 0xFFFF
    return value


def _crc_of_byte(byte: int) -> int:
    value = byte << 8
    for _ in range(8):
        value = (value << 1 ^ _POLYNOMIAL if value & 0x8000 else value << 1) & 0xFFFF
    return value


_CRC_OF = tuple(_crc_of_byte(byte) for byte in range(256))


def encode(servo: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet; FF FF FD inside it is stuffed with another FD."""
    body = (bytes((instruction,)) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = HEADER + bytes((servo,)) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + crc16(packet).to_bytes(2, "little")


@dataclass(frozen=True)
class Packet:
    """A packet with a right CRC."""

    servo: int
    instruction: int
    parameters: bytes


class Parser:
    """Finds packets in a stream of bytes."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes; return the packets that are complete now."""
        self._waiting += data
        found = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> Packet | None:
        while (start := self._waiting.find(HEADER)) >= 0:
            del self._waiting[:start]
            if len(self._waiting) < _BODY_AT:
                return None
            end = _BODY_AT + int.from_bytes(self._waiting[_LENGTH_AT:_BODY_AT], "little")
            if end > _LONGEST_PACKET:
                del self._waiting[:1]
                continue
            if len(self._waiting) < end:
                return None
            raw = bytes(self._waiting[:end])
            if end >= _BODY_AT + 3 and crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little"):
                del self._waiting[:end]
                body = raw[_BODY_AT:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
                return Packet(raw[4], body[0], body[1:])
            del self._waiting[:1]  # a header by chance, or a broken packet
        return None
