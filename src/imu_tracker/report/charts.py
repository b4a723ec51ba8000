"""Charts as inline SVG: they stretch with the page, their words do not."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from typing import Final, NamedTuple

from imu_tracker.report.measures.series import Bin, Series
from imu_tracker.storage.latlong import format_utc

WIDTH: Final = 1000.0
HEIGHT: Final = 200.0
TICKS: Final = 4


class Span(NamedTuple):
    """Seconds that the chart spans, and the UTC at 0; NaN when it is not known."""

    length_s: float
    zero_utc_s: float


class Scale(NamedTuple):
    """Values from bottom to top; logarithmic for what spans decades."""

    low: float
    high: float
    is_log: bool

    def y(self, value: float) -> float:
        """Return the height of a value, 0 at the top."""
        low, high = self.low, self.high
        if self.is_log:
            value, low, high = (math.log(max(v, 1e-9)) for v in (value, low, high))
        share = (value - low) / (high - low)
        return HEIGHT * (1.0 - min(max(share, 0.0), 1.0))


def line_chart(
    title: str,
    unit: str,
    series: Series,
    span: Span,
    *,
    shades: Sequence[tuple[float, float]] = (),
    is_log: bool = False,
) -> str:
    """Draw the mean as a line in the band between least and greatest.

    Parameters
    ----------
    title, unit : str
        The unit may be empty.
    series : Series
    span : Span
    shades : sequence of (begin, end) in seconds
        Outages, shaded.
    is_log : bool
        Whether the values' axis is logarithmic.
    """
    bins = series.bins()
    if not bins:
        return ""
    scale = _scale(bins, is_log=is_log)
    marks = [
        f'<rect class="dark" x="{_x(begin, span):.1f}" y="0" height="{HEIGHT:g}" '
        f'width="{max(_x(end, span) - _x(begin, span), 1.0):.1f}"/>'
        for begin, end in shades
    ]
    for run in _runs(bins, series.width_s):
        points = [(_x(b.t_s, span), b) for b in run]
        top = [f"{x:.1f},{scale.y(b.greatest):.1f}" for x, b in points]
        bottom = [f"{x:.1f},{scale.y(b.least):.1f}" for x, b in reversed(points)]
        mean = " ".join(f"{x:.1f},{scale.y(b.mean):.1f}" for x, b in points)
        marks.append(f'<polygon class="band" points="{" ".join(top + bottom)}"/>')
        marks.append(f'<polyline class="mean" points="{mean}"/>')
    return _figure(title, unit, scale, _times(span), "".join(marks))


def bar_chart(
    title: str,
    unit: str,
    bars: Sequence[tuple[float, float]],
    wide_s: float,
    span: Span,
    *,
    high: float,
    wanted: float,
) -> str:
    """Draw bars from 0 to `high`, and a line at the value that is wanted.

    Parameters
    ----------
    bars : sequence of (begin, value)
        In seconds since the beginning.
    wide_s : float
        Seconds of a bar.
    """
    if not bars:
        return ""
    scale = Scale(0.0, high, is_log=False)
    marks = []
    for begin_s, value in bars:
        x = _x(max(begin_s, 0.0), span)
        wide = max(_x(min(begin_s + wide_s, span.length_s), span) - x - 1.0, 1.0)
        y = scale.y(value)
        marks.append(
            f'<rect class="bar" x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" '
            f'height="{max(HEIGHT - y, 1.0):.1f}"/>'
        )
    y = scale.y(wanted)
    marks.append(f'<line class="wanted" x1="0" x2="{WIDTH:g}" y1="{y}" y2="{y}"/>')
    return _figure(title, unit, scale, _times(span), "".join(marks))


def _figure(
    title: str, unit: str, scale: Scale, times: Sequence[tuple[float, str]], marks: str
) -> str:
    ticks = _ticks(scale)
    grid = "".join(
        f'<line class="grid" x1="0" x2="{WIDTH:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
        for y in map(scale.y, ticks)
    )
    values = "".join(
        f'<span style="top:{100.0 * scale.y(tick) / HEIGHT:.1f}%">{tick:g}</span>'
        for tick in ticks
    )
    below = "".join(
        f'<span style="left:{100.0 * share:.1f}%">{escape(text)}</span>'
        for share, text in times
    )
    caption = escape(title) + (f" <small>{escape(unit)}</small>" if unit else "")
    return (
        f'<figure class="chart"><figcaption>{caption}</figcaption>'
        f'<div class="plot"><div class="values">{values}</div>'
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none" '
        f'role="img" aria-label="{escape(title)} over time">{grid}{marks}</svg>'
        f'<div class="times">{below}</div></div></figure>'
    )


def _scale(bins: Sequence[Bin], *, is_log: bool) -> Scale:
    low = min(b.least for b in bins)
    high = max(b.greatest for b in bins)
    if is_log:
        low = 10.0 ** math.floor(math.log10(max(low, 0.01)))
        high = 10.0 ** math.ceil(math.log10(max(high, 10.0 * low)))
        return Scale(low, high, is_log=True)
    if 0.0 <= low < 0.7 * high:
        low = 0.0
    middle, least = 0.5 * (low + high), max(0.1 * abs(high), 1.0)
    if high - low < least:  # what hardly changes must not look as if it did
        low, high = middle - 0.5 * least, middle + 0.5 * least
    step = _step(high - low)
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return Scale(low, high if high > low else low + step, is_log=False)


def _ticks(scale: Scale) -> list[float]:
    if scale.is_log:
        decades = round(math.log10(scale.high / scale.low))
        return [scale.low * 10.0**i for i in range(decades + 1)]
    step = _step(scale.high - scale.low)
    n = round((scale.high - scale.low) / step)
    return [round(scale.low + i * step, 6) for i in range(n + 1)]


def _step(width: float) -> float:
    """Return a round step of which a few fit in."""
    ten = 10.0 ** math.floor(math.log10(width / TICKS))
    return next(n * ten for n in (1.0, 2.0, 5.0, 10.0) if n * ten * TICKS >= width)


def _x(t_s: float, span: Span) -> float:
    return WIDTH * min(max(t_s / max(span.length_s, 1e-9), 0.0), 1.0)


def _times(span: Span) -> list[tuple[float, str]]:
    """Return a few instants along the chart: share of the width, and words."""
    shares = (0.0, 0.25, 0.5, 0.75, 1.0)
    if math.isnan(span.zero_utc_s):
        return [(share, f"{share * span.length_s:.0f} s") for share in shares]
    texts = [format_utc(span.zero_utc_s + share * span.length_s) for share in shares]
    end = 19 if span.length_s < 300.0 else 16
    return [(s, text[11:end]) for s, text in zip(shares, texts, strict=True)]


def _runs(bins: Sequence[Bin], width_s: float) -> Iterator[list[Bin]]:
    """Cut where nothing came for a while: no line is drawn across."""
    run: list[Bin] = []
    for one in bins:
        if run and one.t_s - run[-1].t_s > max(5.0 * width_s, 15.0):
            yield run
            run = []
        run.append(one)
    if run:
        yield run
