"""The colours of frames, for each theme. The colours of ghosts and round ends are in :mod:`pacman_env.game`."""

from typing import Literal, NamedTuple

Colour = tuple[int, int, int]
Theme = Literal["light", "dark"]


class Palette(NamedTuple):
    # the map
    floor: Colour = (253, 253, 250)
    wall: Colour = (44, 50, 66)
    unknown: Colour = (197, 202, 209)
    out_of_reach: Colour = (226, 228, 231)
    # the legend and the header
    page: Colour = (241, 242, 244)
    ink: Colour = (38, 42, 54)
    header: Colour = (27, 31, 43)
    text: Colour = (245, 246, 248)
    muted: Colour = (164, 172, 186)
    # symbols
    pac: Colour = (255, 214, 0)
    outline: Colour = (48, 42, 24)
    ghost_outline: Colour = (48, 42, 24)
    eye: Colour = (255, 255, 255)
    pupil: Colour = (22, 40, 110)
    plan: Colour = (25, 103, 210)
    belief: Colour = (142, 36, 170)
    danger: Colour = (214, 40, 40)
    place: Colour = (0, 128, 110)
    place_fill: Colour = (222, 244, 238)
    collected: Colour = (160, 164, 172)


LIGHT = Palette()
DARK = Palette(
    floor=(27, 34, 51), wall=(98, 122, 220), unknown=(13, 16, 24), out_of_reach=(18, 22, 34),
    page=(13, 16, 24), ink=(238, 241, 248), ghost_outline=(150, 162, 196), plan=(127, 169, 255), belief=(213, 155, 255),
    danger=(255, 98, 98), place=(79, 209, 181), place_fill=(14, 58, 54), collected=(104, 117, 148),
)  # fmt: skip
THEMES: dict[Theme, Palette] = {"light": LIGHT, "dark": DARK}
