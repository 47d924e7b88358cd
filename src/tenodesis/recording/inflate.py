"""Decompression within bounds, which ``mcap`` does not have: a small file may say, and hold, gigabytes."""

import lz4.frame
import zstandard

LARGEST_CHUNK = 256 * 2**20
"""Largest content of a chunk, bytes."""
_FREE, _RATIO = 32 * 2**20, 48
"""Bytes that any file may inflate to, and how many more by a byte of it; recordings have a ratio of up to 30."""
_FREE_RECORDS, _BYTES_PER_RECORD = 500_000, 2
"""Records that any file may hold in chunks, and the bytes of it that each further one takes; recordings take 4."""


class InflationError(Exception):
    """Compressed data hold more than allowed; the message is the end of a sentence about them."""


class Allowance:
    """What a file's chunks may still hold.

    Parameters
    ----------
    size
        Of the file, bytes.
    """

    def __init__(self, size: int) -> None:
        self._bytes = _FREE + _RATIO * size
        self._records = _FREE_RECORDS + size // _BYTES_PER_RECORD

    def take_bytes(self, count: int) -> None:
        """Take so many bytes; raises InflationError where they are too many."""
        if count > LARGEST_CHUNK:
            raise InflationError(
                f"says that it holds {count / 1e6:.3g} MB; it must hold at most {LARGEST_CHUNK / 1e6:.3g} MB"
            )
        self._bytes -= count
        if self._bytes < 0:
            raise InflationError(f"inflates the file to more than {_RATIO} times its size, which no recording does")

    def take_records(self, count: int) -> None:
        """Take so many records; raises InflationError where they are too many."""
        self._records -= count
        if self._records < 0:
            raise InflationError(f"holds records of less than {_BYTES_PER_RECORD} bytes each, which no recording does")


def inflate(data: bytes, compression: str, size: int, allowance: Allowance) -> bytes:
    """Return decompressed data.

    Parameters
    ----------
    data
        Compressed data.
    compression
        Its kind: zstd, lz4, or empty for none.
    size
        Number of bytes that it says to hold.
    allowance
        What it may hold; used up by it.

    Raises
    ------
    InflationError
        It holds more.
    ValueError
        It does not hold as many bytes as it says, or is of another kind.
    """
    if not compression:
        # It is as large as the file says.
        return data
    allowance.take_bytes(size)
    if compression == "zstd":
        # The frame's own size would be allocated, whatever is asked for.
        if zstandard.frame_content_size(data) > size:
            raise InflationError(f"holds more than the {size} bytes that it says")
        found = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    elif compression == "lz4":
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    else:
        raise ValueError(f"its compression is {compression!r}; it must be zstd or lz4")
    if len(found) != size:
        raise ValueError(f"it holds {len(found)} bytes, not {size}")
    return found
