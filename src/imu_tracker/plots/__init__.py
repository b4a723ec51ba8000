"""Pictures, drawn by matplotlib without a display: `tracks` and `recording`.

Made for one look: a few thousand points a line and some sixty circles, however long
the track. The colours are those of Okabe and Ito, which colour-blind readers can tell
apart. Importing one of the modules imports matplotlib.
"""
