"""Chunks of a long recording, on each of which a job of its own can work."""

# A job starts in ten seconds and works on a chunk for minutes. Features depend on it in their last digits where a recording is
# longer, because no batch of crops goes beyond a chunk.
CHUNK_FRAMES = 500


def split_frames(count: int) -> list[range]:
    """Split the frames of a recording into chunks."""
    return [range(begin, min(begin + CHUNK_FRAMES, count)) for begin in range(0, count, CHUNK_FRAMES)]
