"""The fault campaign: what can befall a tracker, in every phase of a drive.

`table` is what is read first: each fault, what it does, and what must be true of it.
`bench` runs the whole daemon (its loop, both sensor threads, all files) on a chip, a
bus, a receiver and a clock that are models; a minute takes a second.
"""
