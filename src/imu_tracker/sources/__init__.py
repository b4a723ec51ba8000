"""Where frames come from: hardware, a recording, or the simulator.

In: the configuration. Out: one stream of `Frame` in batches (`Feed`). Not here:
decoding and estimation; the stream is the same for all three.
"""

__all__ = ["factory", "feed", "live", "played", "polled"]
