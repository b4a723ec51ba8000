"""Exports: lat/long logs in the formats of other programs, and as a map.

`merging` makes one stream of points out of any number of logs; each format turns that
stream into text as it comes, so that a year of rows needs no more memory than an hour.
"""
