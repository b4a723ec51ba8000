"""One target under atheris, in this process; `python -m fuzz` starts it."""

import sys
import warnings

import atheris


def main() -> None:
    # Filters compute the same whatever the numbers are: their branches lead nowhere,
    # and tracing them takes longer than they do.
    with atheris.instrument_imports(
        include=["imu_tracker"], exclude=["imu_tracker.estimation"]
    ):
        from fuzz.targets import TARGETS
    warnings.simplefilter("error")
    atheris.Setup([sys.argv[0], *sys.argv[2:]], TARGETS[sys.argv[1]].run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
