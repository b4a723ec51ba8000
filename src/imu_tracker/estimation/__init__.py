"""From events to estimates: pure algorithms, without clock, file, thread or log."""
