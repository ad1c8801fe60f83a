"""STEP files (ISO 10303-21, AP214) written as text: plates with true cylinders, and facets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

_UNITS = {
    "mm": ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",),
    "m": ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))",),
    "inch": (
        "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",
        "LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{0})",
        "DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)",
        "(CONVERSION_BASED_UNIT('INCH',#{1})LENGTH_UNIT()NAMED_UNIT(#{2}))",
    ),
}


class StepText:
    """The lines of a file; each entity is numbered when it is added."""

    def __init__(self, unit: str = "mm") -> None:
        self.lines: list[str] = []
        self.unit = unit

    def add(self, entity: str) -> str:
        self.lines.append(entity)
        return f"#{len(self.lines)}"

    def point(self, at: Iterable[float]) -> str:
        return self.add(f"CARTESIAN_POINT('',{_numbers(at)})")

    def direction(self, along: Iterable[float]) -> str:
        return self.add(f"DIRECTION('',{_numbers(along)})")

    def vertex(self, at: Iterable[float]) -> str:
        return self.add(f"VERTEX_POINT('',{self.point(at)})")

    def placement(self, at: Iterable[float], axis: Sequence[float], along: Sequence[float]) -> str:
        parts = f"{self.point(at)},{self.direction(axis)},{self.direction(along)}"
        return self.add(f"AXIS2_PLACEMENT_3D('',{parts})")

    def plane(self, at: Iterable[float], axis: Sequence[float]) -> str:
        along = np.cross(axis, [1, 0, 0] if abs(axis[0]) < 0.8 else [0, 1, 0])
        placed = self.placement(at, axis, along / np.linalg.norm(along))
        return self.add(f"PLANE('',{placed})")

    def line(self, a: str, b: str, start: np.ndarray, end: np.ndarray) -> str:
        along = end - start
        length = float(np.linalg.norm(along))
        vector = self.add(f"VECTOR('',{self.direction(along / length)},{length!r})")
        curve = self.add(f"LINE('',{self.point(start)},{vector})")
        return self.add(f"EDGE_CURVE('',{a},{b},{curve},.T.)")

    def oriented(self, edge: str, forward: bool) -> str:
        return self.add(f"ORIENTED_EDGE('',*,*,{edge},{'.T.' if forward else '.F.'})")

    def loop(self, edges: Sequence[tuple[str, bool]]) -> str:
        return self.add(f"EDGE_LOOP('',({','.join(self.oriented(*edge) for edge in edges)}))")

    def face(self, outer: str, inner: Sequence[str], surface: str, same: bool = True) -> str:
        bounds = [self.add(f"FACE_OUTER_BOUND('',{outer},.T.)")]
        bounds += [self.add(f"FACE_BOUND('',{each},.T.)") for each in inner]
        return self.add(
            f"ADVANCED_FACE('',({','.join(bounds)}),{surface},{'.T.' if same else '.F.'})"
        )

    def text(self, item: str, shape: str) -> str:
        """Close the file about one item of a shape representation."""
        numbers: list[str] = []
        for unit in _UNITS[self.unit]:
            numbers.append(self.add(unit.format(*(each[1:] for each in numbers))))
        length = numbers[-1]
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        solid = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        close = self.add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{length},'distance','')"
        )
        context = self.add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(("
            f"{close}))GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))"
            "REPRESENTATION_CONTEXT('',''))"
        )
        origin = self.placement((0, 0, 0), (0, 0, 1), (1, 0, 0))
        shown = self.add(f"{shape}('',({origin},{item}),{context})")
        application = self.add("APPLICATION_CONTEXT('automotive design')")
        product_context = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        product = self.add(f"PRODUCT('part','part','',({product_context}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        stage = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{stage})")
        defined = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({defined},{shown})")
        body = "\n".join(f"#{n}={line};" for n, line in enumerate(self.lines, start=1))
        return (
            "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
            "FILE_NAME('part','2026-01-01T00:00:00',(''),(''),'','','');\n"
            "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
            f"{body}\nENDSEC;\nEND-ISO-10303-21;\n"
        )


def _numbers(values: Iterable[float]) -> str:
    return "(" + ",".join(repr(float(value)) for value in values) + ")"


def drilled_plate(
    size: tuple[float, float, float],
    holes: Sequence[tuple[float, float, float]],
    unit: str = "mm",
) -> str:
    """A plate from (0, 0, −thickness) to (length, width, 0) with true cylinders (x, y, radius)."""
    step = StepText(unit)
    length, width, thick = size
    flat = np.array([[0, 0], [length, 0], [length, width], [0, width]], dtype=float)
    corners = {z: np.column_stack([flat, np.full(4, z)]) for z in (0.0, -thick)}
    points = {z: [step.vertex(at) for at in corners[z]] for z in corners}
    rims = {
        z: [
            step.line(points[z][i], points[z][(i + 1) % 4], corners[z][i], corners[z][(i + 1) % 4])
            for i in range(4)
        ]
        for z in corners
    }
    posts = [
        step.line(points[-thick][i], points[0.0][i], corners[-thick][i], corners[0.0][i])
        for i in range(4)
    ]
    faces, circles = [], {0.0: [], -thick: []}
    for x, y, radius in holes:
        ends, edges = {}, {}
        for z in (0.0, -thick):
            ends[z] = np.array([x + radius, y, z])
            placed = step.placement((x, y, z), (0, 0, 1), (1, 0, 0))
            circle = step.add(f"CIRCLE('',{placed},{float(radius)!r})")
            vertex = step.vertex(ends[z])
            edges[z] = (step.add(f"EDGE_CURVE('',{vertex},{vertex},{circle},.T.)"), vertex)
            circles[z].append(edges[z][0])
        seam = step.line(edges[-thick][1], edges[0.0][1], ends[-thick], ends[0.0])
        placed = step.placement((x, y, -thick), (0, 0, 1), (1, 0, 0))
        wall = step.add(f"CYLINDRICAL_SURFACE('',{placed},{float(radius)!r})")
        around = step.loop(
            [(edges[0.0][0], True), (seam, False), (edges[-thick][0], False), (seam, True)]
        )
        faces.append(step.face(around, [], wall, same=False))
    top = step.loop([(edge, True) for edge in rims[0.0]])
    inner = [step.loop([(edge, False)]) for edge in circles[0.0]]
    faces.append(step.face(top, inner, step.plane((0, 0, 0), (0, 0, 1))))
    bottom = step.loop([(edge, False) for edge in reversed(rims[-thick])])
    inner = [step.loop([(edge, True)]) for edge in circles[-thick]]
    faces.append(step.face(bottom, inner, step.plane((0, 0, -thick), (0, 0, -1))))
    outward = ((0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0))
    for i in range(4):
        j = (i + 1) % 4
        side = step.loop(
            [(rims[-thick][i], True), (posts[j], True), (rims[0.0][i], False), (posts[i], False)]
        )
        faces.append(step.face(side, [], step.plane(corners[0.0][i], outward[i])))
    shell = step.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = step.add(f"MANIFOLD_SOLID_BREP('',{shell})")
    return step.text(solid, "ADVANCED_BREP_SHAPE_REPRESENTATION")


def facets(vertices: np.ndarray, faces: np.ndarray, unit: str = "mm") -> str:
    """A mesh as a faceted body of planar triangles."""
    step = StepText(unit)
    points = [step.point(at) for at in vertices.tolist()]
    shell = []
    for corners in faces.tolist():
        a, b, c = vertices[corners]
        normal = np.cross(b - a, c - a)
        loop = step.add(f"POLY_LOOP('',({','.join(points[i] for i in corners)}))")
        bound = step.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        plane = step.plane(a, normal / np.linalg.norm(normal))
        shell.append(step.add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    body = step.add(
        f"FACETED_BREP('',{step.add(f'CLOSED_SHELL({chr(39) * 2},({chr(44).join(shell)}))')})"
    )
    return step.text(body, "FACETED_BREP_SHAPE_REPRESENTATION")
