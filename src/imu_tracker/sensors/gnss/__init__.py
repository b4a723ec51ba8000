"""The GPS receiver.

In: bytes of a serial or network port. Out: lines, sentences, epochs, `GpsFix`. Pure but
for `port`, `baud` and `reader`. Not here: what a fix is worth (`estimation/receiver/`).
"""

__all__ = ["calendar", "epoch", "epoch_reader", "lines", "reader", "sentences"]
