"""LZF decompression, as in compressed PCD files (format: LibLZF by M. Lehmann)."""

from treadline.core.errors import ImageError


def decompress(data: bytes, size: int) -> bytes:
    """Return the decompressed bytes.

    Raises:
        ImageError: If the data does not decompress to ``size`` bytes.
    """
    plain = bytearray()
    at = 0
    try:
        while at < len(data) and len(plain) <= size:
            control = data[at]
            at += 1
            if control < 32:  # a run of control + 1 literal bytes
                plain += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:  # a longer repetition has one more byte of length
                length += data[at]
                at += 1
            start = len(plain) - ((control & 0x1F) << 8) - data[at] - 1
            at += 1
            if start < 0:
                raise ImageError("damaged compressed data: a reference points before its start")
            piece = plain[start : start + length + 2]
            while len(piece) < length + 2:  # the repetition overlaps its own output
                piece += piece[: length + 2 - len(piece)]
            plain += piece
    except IndexError:
        raise ImageError("truncated compressed data") from None
    if len(plain) != size:
        raise ImageError(f"compressed data of {len(plain)} bytes; {size} are declared")
    return bytes(plain)
