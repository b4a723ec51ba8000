"""Every reader, and the whole way to the rows, fed with what nobody should send.

A bounded share of what `make fuzz` does for hours.
"""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz.targets import TARGETS, Target

CASES = {"six-state": 60, "error-state": 40}


@st.composite
def mutated(draw: st.DrawFn, target: Target) -> bytes:
    """A good file with some edits: what is read far enough to hurt."""
    data = bytearray(draw(st.sampled_from(target.seeds)))
    for _ in range(draw(st.integers(0, 6))):
        at = draw(st.integers(0, len(data)))
        end = draw(st.integers(at, min(at + 40, len(data))))
        words = st.sampled_from(target.words) if target.words else st.nothing()
        piece = draw(words | st.binary(max_size=8) | st.just(bytes(data[:end])))
        data[at:end] = piece * draw(st.sampled_from([1, 1, 1, 2, 30]))
    return bytes(data[: 4 * target.max_bytes])


@pytest.mark.parametrize("name", TARGETS)
def test_no_bytes_are_a_crash(name: str) -> None:
    target = TARGETS[name]
    cases = mutated(target) | st.binary(max_size=target.max_bytes)

    @settings(
        max_examples=CASES.get(name, 300),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        print_blob=False,
    )
    @given(cases)
    def check(data: bytes) -> None:
        target.run(data)

    for seed in target.seeds:
        target.run(seed)
    check()
