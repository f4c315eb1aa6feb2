"""What an MCAP file or a compressed one says of itself, before its messages are read: checksums, counts and sizes."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import BinaryIO

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, Message, Statistics
from mcap.stream_reader import StreamReader

from pinotwin.logs.files.content import BROKEN, limited, undamaged

BROKEN_MCAP = (*BROKEN, McapError, zstandard.ZstdError)
REMEDY = "recover it with `mcap recover`"
Stream = BinaryIO | zstandard.ZstdDecompressionReader


def verify(path: Path, source: str) -> None:
    """Refuse an MCAP file that differs from its checksums, lost messages, or unpacks to more than it may."""
    size, unpacked, messages, stated = path.stat().st_size, 0, 0, None
    with undamaged(source, BROKEN_MCAP, REMEDY):
        with path.open("rb") as file:
            reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size)
            for record in reader.records:
                if isinstance(record, Chunk):
                    unpacked += record.uncompressed_size // 8
                    limited(source, unpacked, size)
                    messages += _messages(_records(record))
                    # while it is read a message takes the memory of so many numbers
                    limited(source, unpacked + 32 * messages, size)
                elif isinstance(record, Message):
                    messages += 1
                elif isinstance(record, Statistics):
                    stated = record.message_count
                elif isinstance(record, Footer):  # of 25 bytes before its checksum; 12 follow
                    file.seek(record.summary_start or size - 37)
                    _agree(file.read()[:-12], record.summary_crc, "summary")
                    file.seek(-8, 2)
        if stated not in (None, messages):
            raise ValueError(f"{messages} messages of {stated}")


def _agree(data: bytes, crc: int, what: str) -> None:
    if crc and zlib.crc32(data) != crc:
        raise ValueError(f"checksum of the {what}")


def _records(chunk: Chunk) -> bytes:
    data, most = chunk.data, chunk.uncompressed_size + 1
    if chunk.compression == "zstd":
        data = zstd(data).read(most)
    elif chunk.compression == "lz4":
        data = LZ4FrameDecompressor().decompress(data, max_length=most)
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"a chunk of {len(data)} bytes instead of {chunk.uncompressed_size}")
    _agree(data, chunk.uncompressed_crc, "chunk")
    return data


def _messages(records: bytes) -> int:
    at = count = 0
    while at < len(records):
        count += records[at] == Opcode.MESSAGE
        at += 9 + int.from_bytes(records[at + 1 : at + 9], "little")
    if at > len(records):
        raise ValueError("a record is longer than its chunk")
    return count


def zstd(packed: bytes | BinaryIO) -> zstandard.ZstdDecompressionReader:
    """Return what Zstandard unpacks, as a stream."""
    return zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)


def unpacked(stream: Stream, source: str, size: int, before: int = 0) -> int:
    """Return how many bytes a stream holds beside those ``before``, refused above what a file of ``size`` may hold."""
    with stream:
        while part := stream.read(1 << 20):
            before += len(part)
            limited(source, before // 8, size)
    return before
