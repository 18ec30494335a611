from .curves import Curve as Curve, PlotContents as PlotContents, picture_of as picture_of
from .drawing import draw_svg as draw_svg, save as save
