"""Draw the sketches of the pages: python -m netfall.docs.sketches

Writes the SVG files of `pages/figures`. Each sketch is a function without arguments that returns a `Sketch`.
"""

import csv
import math
from collections.abc import Callable
from pathlib import Path

FIGURES = Path(__file__).with_name("pages") / "figures"
INK, BLUE, RED, GREEN, GREY, PALE = "#222222", "#0072b2", "#d55e00", "#009e73", "#777777", "#cfe3f1"
Point = tuple[float, float]


class Sketch:
    """An SVG picture under construction, in pixels: x to the right, y downwards."""

    def __init__(self, width: int, height: int, meaning: str):
        self.head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" role="img" font-family="sans-serif" font-size="13">\n'
            f'<title>{meaning}</title>\n<rect width="{width}" height="{height}" fill="white"/>\n'
        )
        self.parts: list[str] = []

    def line(self, *points: Point, colour: str = INK, width: float = 1.5, dashed: bool = False) -> None:
        """Add a polyline."""
        dashes = ' stroke-dasharray="5 4"' if dashed else ""
        style = f'fill="none" stroke="{colour}" stroke-width="{width}"{dashes}'
        self.parts.append(f'<polyline points="{_text(points)}" {style}/>')

    def area(self, *points: Point, colour: str = PALE) -> None:
        """Add a filled polygon."""
        self.parts.append(f'<polygon points="{_text(points)}" fill="{colour}"/>')

    def dot(self, at: Point, radius: float = 4.0, colour: str = INK) -> None:
        """Add a filled circle."""
        self.parts.append(f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{colour}"/>')

    def support(self, at: Point) -> None:
        """Add a black square."""
        x, y = at
        self.area((x - 5, y - 5), (x + 5, y - 5), (x + 5, y + 5), (x - 5, y + 5), colour=INK)

    def arrow(self, start: Point, end: Point, colour: str = INK, width: float = 2.0) -> None:
        """Add a line with a head at its end."""
        angle = math.atan2(end[1] - start[1], end[0] - start[0])
        back = [(end[0] - 10 * math.cos(angle + s), end[1] - 10 * math.sin(angle + s)) for s in (0.4, -0.4)]
        neck = (0.5 * (back[0][0] + back[1][0]), 0.5 * (back[0][1] + back[1][1]))
        self.line(start, neck, colour=colour, width=width)
        self.area(end, *back, colour=colour)

    def text(self, at: Point, words: str, colour: str = INK, anchor: str = "start", size: int = 13) -> None:
        """Add a line of text; anchor : "start", "middle" or "end" """
        self.parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{colour}" text-anchor="{anchor}" '
            f'font-size="{size}">{words}</text>'
        )

    def svg(self) -> str:
        """Return the text of the file."""
        return self.head + "\n".join(self.parts) + "\n</svg>\n"


def _text(points: tuple[Point, ...]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def axes() -> Sketch:
    """Axes, direction of the wind, signs of loads and forces."""
    s = Sketch(760, 290, "Axes and signs")
    s.text((20, 24), "Plan: direction of the wind", size=15)
    o = (60.0, 230.0)
    s.arrow(o, (250, 230))
    s.text((255, 234), "x")
    s.arrow(o, (60, 60))
    s.text((54, 52), "y")
    c, d = math.cos(math.radians(30)), math.sin(math.radians(30))
    s.arrow((o[0] + 20 * c, o[1] - 20 * d), (o[0] + 170 * c, o[1] - 170 * d), colour=BLUE, width=3)
    angles = [math.radians(angle) for angle in range(0, 31, 5)]
    s.line(*((o[0] + 90 * math.cos(a), o[1] - 90 * math.sin(a)) for a in angles))
    s.text((158, 214), "30°")
    for k, words in enumerate(("direction = 30:", "blows to 30°,", "comes from 210°")):
        s.text((90, 85 + 17 * k), words, colour=BLUE)

    s.text((300, 24), "Section: loads on the roof", size=15)
    roof = [(310 + 20 * k, 170 - 40 * math.sin(math.pi * k / 11)) for k in range(12)]
    s.line(*roof, width=3)
    s.arrow((300, 240), (300, 190))
    s.text((296, 258), "z up")
    s.arrow((350, 75), (362, 132), colour=RED)
    s.text((308, 48), "pressure &gt; 0 presses", colour=RED)
    s.text((308, 64), "against the normal", colour=RED)
    s.arrow((470, 128), (484, 72), colour=GREEN)
    s.text((462, 48), "pressure &lt; 0", colour=GREEN)
    s.text((462, 64), "lifts", colour=GREEN)
    for x in (390, 410, 430):
        s.arrow((x, 165), (x, 205), colour=BLUE)
    s.text((345, 224), "dead &gt; 0: on the surface, down", colour=BLUE)
    s.text((345, 241), "snow &gt; 0: on the plan area, down", colour=BLUE)
    s.text((345, 258), "load_z &lt; 0: down", colour=BLUE)

    s.text((570, 24), "Force of an element", size=15)
    for y, sign, words in ((80, 1, "N &gt; 0: tension"), (170, -1, "N &lt; 0: compression")):
        s.line((620, y), (690, y), width=4)
        for x, way in ((620, -1), (690, 1)):
            ends = ((x + 6 * way, y), (x + 46 * way, y))
            s.arrow(*(ends if sign > 0 else ends[::-1]), colour=RED)
            s.dot((x, y))
        s.text((655, y + 30), words, anchor="middle")
    s.text((655, 217), "bars only", anchor="middle")
    return s


def areas() -> Sketch:
    """The faces of a net in plan, and the tributary area of a node."""
    s = Sketch(700, 300, "Faces and the tributary area of a node")
    grid = [[(40 + 105 * i + 12 * j, 50 + 100 * j - 10 * i) for i in range(3)] for j in range(3)]

    def middle(*points: Point) -> Point:
        return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)

    centre, around = grid[1][1], [(1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1), (0, 2)]
    ring: list[Point] = []
    for k, (j, i) in enumerate(around):
        if k % 2:
            before, after = around[k - 1], around[(k + 1) % 8]
            ring.append(middle(centre, grid[j][i], *(grid[a][b] for a, b in (before, after))))
        else:
            ring.append(middle(centre, grid[j][i]))
    s.area(*ring)
    for k in range(3):
        s.line(*grid[k], width=2)
        s.line(*(grid[j][k] for j in range(3)), width=2)
    face = (grid[0][0], grid[0][1], grid[1][1], grid[1][0])
    for corner in face:
        s.line(middle(*face), corner, colour=GREY, dashed=True)
    s.dot(middle(*face), 3, GREY)
    for row in grid:
        for point in row:
            s.dot(point)
    s.dot(centre, 6, BLUE)
    words = (
        (INK, "A face is the smallest closed ring of elements in plan."),
        (GREY, "It is cut into triangles from its centroid (dashed)."),
        (GREY, "Half of each triangle goes to either end of its side."),
        (BLUE, "So the blue node has the blue part of four faces."),
        (INK, "What acts on the node:"),
        (INK, "dead load on the area of the surface,"),
        (INK, "snow on the area in plan,"),
        (INK, "pressure and wind on the vector area."),
    )
    for k, (colour, line) in enumerate(words):
        s.text((310, 60 + 26 * k), line, colour)
    return s


def fracture() -> Sketch:
    """A particle before and after the fracture of one of its elements."""
    s = Sketch(740, 250, "A particle splits where an element breaks")
    for x, heading in ((150.0, "Before"), (470.0, "After the fracture")):
        s.text((x, 28), heading, anchor="middle", size=15)
        at = (x, 125.0)
        for end in ((x - 95, 145), (x, 60), (x, 195)):
            s.line(at, end, colour=BLUE, width=3)
        s.dot(at, 9, BLUE)
    s.line((150, 125), (245, 105), colour=RED, width=3)
    s.text((172, 92), "reaches its strength", colour=RED)
    s.line((500, 140), (590, 112), colour=RED, width=3)
    s.dot((500, 140), 6, RED)
    for k, words in enumerate(("fragment end: a new particle", "with half the mass of the element")):
        s.text((508, 162 + 16 * k), words, colour=RED)
    s.text((150, 222), "one particle, four elements", anchor="middle")
    s.text((470, 222), "the particle keeps three elements", anchor="middle")
    return s


def masted_net() -> Sketch:
    """The canopy of the tutorial in plan, with the numbers of its nodes, and in elevation."""
    s = Sketch(760, 560, "Canopy with two masts: plan and elevation")
    nodes, elements = (_table("masted-net.md", name) for name in ("nodes.csv", "elements.csv"))
    place = {row["id"]: tuple(float(row[axis]) for axis in "xyz") for row in nodes}
    colours = {"hanging": BLUE, "bracing": GREEN, "edge": RED, "stay": GREY, "mast": INK}

    def plan(x: float, y: float, _: float) -> Point:
        return 380 + 17 * x, 210 - 14 * y

    def elevation(x: float, _: float, z: float) -> Point:
        return 380 + 17 * x, 530 - 14 * z

    s.line(elevation(-20, 0, 0), elevation(20, 0, 0), colour=GREY, width=1)
    for view in (plan, elevation):
        for row in elements[1:]:
            width = 3.0 if row["group"] in ("edge", "mast") else 1.5
            ends = (view(*place[row[end]]) for end in ("start", "end"))
            s.line(*ends, colour=colours[row["group"]], width=width)
        for row in nodes:
            at = view(*place[row["id"]])
            is_support = row["fixed"] == "1" and row["id"] not in ("10", "16")
            s.support(at) if is_support else s.dot(at, 3)
            if view is plan:
                below = row["id"] in ("31", "32")
                s.text((at[0] + 6, at[1] + (18 if below else -7)), row["id"], size=12)
    s.arrow((30, 380), (90, 380))
    s.arrow((30, 380), (30, 320))
    s.text((94, 384), "x")
    s.text((26, 314), "y")
    for k, (group, colour) in enumerate(colours.items()):
        s.line((640, 300 + 20 * k), (670, 300 + 20 * k), colour=colour, width=3)
        s.text((678, 304 + 20 * k), group)
    s.text(elevation(-13.5, 0, 8), "8 m", anchor="end")
    s.text(elevation(0.6, 0, 1.2), "2 m")
    return s


def _table(page: str, title: str) -> list[dict[str, str]]:
    """Return the rows of a table that stands in a tutorial."""
    text = (FIGURES.parent / "tutorials" / page).read_text(encoding="utf-8")
    return list(csv.DictReader(text.split(f'```csv title="{title}"\n')[1].split("```")[0].splitlines()))


SKETCHES: dict[str, Callable[[], Sketch]] = {
    "axes": axes,
    "areas": areas,
    "fracture": fracture,
    "masted-net": masted_net,
}

if __name__ == "__main__":
    FIGURES.mkdir(exist_ok=True)
    for name, sketch in SKETCHES.items():
        (FIGURES / f"{name}.svg").write_text(sketch().svg(), encoding="utf-8")
