"""Plots of logs of values: PNG, SVG, and pages that need nothing from elsewhere."""

from drivecomm.value_plots.curves import Picture as Picture
from drivecomm.value_plots.curves import picture_of as picture_of
