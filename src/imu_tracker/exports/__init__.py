"""The log for other programs: GPX, KML, GeoJSON, NMEA, and a map page.

In: rows of the log. Out: text of a file. Not here: reading the log (`storage/`).
"""

__all__ = [
    "geojson",
    "gpx",
    "kml",
    "merging",
    "nmea",
    "page",
    "palette",
    "thinning",
]
