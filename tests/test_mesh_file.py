"""Mesh files: every face arrives, bare and named by an MJCF, or the file is refused with the reason."""

from pathlib import Path

import numpy as np
import pytest
from lidar_target import box
from numpy.typing import NDArray

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.world.craft import load_craft
from swarm.world.mesh_file import read_mesh, triangulated
from swarm.world.surface import surface

SPACECRAFT = Path(__file__).resolve().parents[2] / "shared" / "data" / "spacecraft"
BOXES = [
    box((-0.4, -0.3, -0.5), (0.4, 0.3, 0.5)),
    box((0.5, 0.0, -0.3), (2.3, 0.1, 0.4)),
    box((-2, 0, 0), (-0.5, 1, 1)),
]
AREA = sum(2 * (a * b + b * c + c * a) for a, b, c in (np.ptp(vertex, axis=0) for vertex, _ in BOXES))
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
ELL = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]) * 1.0


def area(vertex: Floats, face: NDArray[np.integer]) -> float:
    corner = vertex[face]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return float(np.linalg.norm(cross, axis=1).sum() / 2)


def volume(vertex: Floats, face: NDArray[np.integer]) -> float:
    """Of a closed surface that faces outward."""
    a, b, c = np.moveaxis(vertex[face], 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6)


def obj(kind: str) -> str:
    """Three boxes, grouped by `kind`."""
    lines = ["# boxes", "mtllib none.mtl"]
    for i, (vertex, face) in enumerate(BOXES):
        lines += {"one": [], "g": [f"g part{i}"], "o": [f"o part{i}"], "both": [f"o p{i}", f"g a b{i}", "s 1"]}.get(
            kind, []
        )
        lines += [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in vertex]
        if kind == "quads":
            lines += ["f " + " ".join(f"{8 * i + k + 1}/1/1" for k in quad) for quad in QUADS]
        elif kind == "negative":
            lines += [f"f {a - 8} {b - 8}//1 {c - 8}" for a, b, c in face]
        elif kind == "continued":
            lines += [f"f {a} {b} \\\n {c} # corner" for a, b, c in 8 * i + face + 1]
        else:
            lines += [f"f {a} {b} {c}" for a, b, c in 8 * i + face + 1]
    return ("\r\n" if kind == "both" else "\n").join(lines) + ("" if kind == "g" else "\n")


def triangles() -> Floats:
    return np.concatenate([vertex[face] for vertex, face in BOXES])


def binary_stl(extra: bytes = b"", header: bytes = b"solid liar") -> bytes:
    record = np.dtype([("n", "<3f4"), ("v", "<(3,3)f4"), ("a", "<u2")])
    out = np.zeros(36, dtype=record)
    out["v"] = triangles()
    return header.ljust(80, b" ") + np.uint32(36).tobytes() + out.tobytes() + extra


def ascii_stl(solids: int = 1) -> str:
    out = ""
    for part in np.split(triangles(), solids):
        out += "solid my facet\n"
        for corner in part:
            points = "".join(f"   vertex {x:e} {y:e} {z:e}\n" for x, y, z in corner)
            out += f" facet normal 0 0 0\n  outer loop\n{points}  endloop\n endfacet\n"
        out += "endsolid\n"
    return out


FILES: dict[str, str | bytes] = {
    **{f"{kind}.obj": obj(kind) for kind in ("one", "g", "o", "both", "quads", "negative", "continued")},
    "bom.obj": "\ufeff" + obj("g"),
    "binary.stl": binary_stl(),
    "ascii.STL": ascii_stl(),
    "solids.stl": ascii_stl(3),
}


@pytest.mark.parametrize("name", FILES)
def test_every_face_arrives(name: str, tmp_path: Path) -> None:
    """Of a bare mesh, and of one that an MJCF names, without a name of its own."""
    content = FILES[name]
    (tmp_path / "parts").mkdir()
    path = tmp_path / "parts" / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    stem = path.stem
    craft = tmp_path / "craft.xml"
    craft.write_text(
        f'<mujoco><compiler meshdir="parts"/><asset><mesh file="{name}" scale="2 2 2"/></asset>'
        f'<worldbody><body><geom type="mesh" mesh="{stem}"/></body></worldbody></mujoco>'
    )
    for file, scale in ((path, 1.0), (craft, 2.0)):
        vertex, face = surface(file)
        assert len(face) == 36
        assert area(vertex, face) == pytest.approx(AREA * scale**2, rel=1e-6)
        assert volume(vertex, face) == pytest.approx((0.96 * 0.5 + 1.8 * 0.1 * 0.7 + 1.5) * scale**3, rel=1e-6)
        np.testing.assert_allclose(vertex.min(axis=0), [-2 * scale, -0.3 * scale, -0.5 * scale], atol=1e-6)


def test_meshes_of_an_attached_model_and_of_an_included_file_arrive_too(tmp_path: Path) -> None:
    (tmp_path / "sub" / "assets").mkdir(parents=True)
    (tmp_path / "sub" / "assets" / "m.obj").write_text(obj("o"))
    assets = '<asset><mesh name="m" file="m.obj"/></asset>'
    body = '<worldbody><body name="k"><geom type="mesh" mesh="m"/></body></worldbody>'
    (tmp_path / "sub" / "child.xml").write_text(f'<mujoco><compiler meshdir="assets"/>{assets}{body}</mujoco>')
    (tmp_path / "attached.xml").write_text(
        '<mujoco><asset><model name="c" file="sub/child.xml"/></asset><worldbody><body name="r"><freejoint/>'
        '<geom size=".1"/><attach model="c" body="k" prefix="c-"/></body></worldbody></mujoco>'
    )
    (tmp_path / "sub" / "assets" / "inc.xml").write_text(f"<mujoco>{assets}</mujoco>")
    (tmp_path / "sub" / "includes.xml").write_text(f'<mujoco><include file="assets/inc.xml"/>{body}</mujoco>')
    (tmp_path / "sub" / "strip.xml").write_text(
        f'<mujoco><compiler meshdir="assets" strippath="true"/>{assets.replace("m.obj", "a/b/m.obj")}{body}</mujoco>'
    )
    for name, more in (("attached", 1), ("sub/child", 0), ("sub/includes", 0), ("sub/strip", 0)):
        parts = load_craft(tmp_path / f"{name}.xml", passive=True).surfaces
        assert [len(mesh.face) for mesh in parts[more:]] == [36]


@pytest.mark.parametrize(("corner", "triangle_count"), [(ELL, 4), (ELL[::-1], 4), (np.roll(ELL, 2, axis=0), 4)])
def test_a_polygon_that_is_not_convex_keeps_its_area_from_all_sides(corner: Floats, triangle_count: int) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        point = np.column_stack([corner, np.full(6, 0.3)]) @ turn
        face = np.array(triangulated(point))
        assert len(face) == triangle_count
        assert area(point, face) == pytest.approx(3.0)
        cross = np.cross(point[face][:, 1] - point[face][:, 0], point[face][:, 2] - point[face][:, 0])
        # All of them face as the polygon does: their areas add up as vectors.
        assert np.linalg.norm(cross.sum(axis=0)) / 2 == pytest.approx(3.0)


def test_a_convex_polygon_is_a_fan_and_a_crossed_one_is_refused() -> None:
    turn = np.arange(7) * 2 * np.pi / 7
    ring = np.column_stack([np.cos(turn), np.zeros(7), np.sin(turn)])
    assert triangulated(ring) == [(0, i, i + 1) for i in range(1, 6)]
    star = ring[(2 * np.arange(7)) % 7]
    with pytest.raises(ValueError, match="edges of a face of 7 corners cross"):
        triangulated(star)


BAD: dict[str, tuple[str | bytes, str]] = {
    "none.obj": ("v 0 0 0\nv 1 0 0\n", "it has no face"),
    "empty.obj": ("", "it has no face"),
    "far.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: corner 4, but the file has 3 vertices"),
    "zero.obj": (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
        "line 4, 'f 0 1 2': corner 0, but vertices are counted from 1",
    ),
    "back.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -1 -2\n", "corner -4.*back from -1 to -3"),
    "two.obj": ("v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3, 'f 1 2': a face has three corners"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a coordinate is not finite"),
    "word.obj": ("v 0 0 x\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1, 'v 0 0 x': could not convert"),
    "short.obj": ("v 0 0\n", "line 1, 'v 0 0': a vertex has three coordinates"),
    "free.obj": ("v 0 0 0\ncstype bspline\nsurf 0 1 0 1 1 2 3\n", "line 2, 'cstype bspline': free-form"),
    "html.obj": ("<html>\n", "line 1, '<html>': this is no OBJ keyword"),
    "cut.stl": (binary_stl()[:-7], r"header says 36 triangles, which take 1884 bytes; the file has 1877"),
    "more.stl": (binary_stl(b"xx"), r"the file has 1886"),
    "tiny.stl": (b"abc", "3 bytes, neither an ASCII nor a binary STL"),
    "zeros.stl": (bytes(84), "it has no face"),
    "cut-text.stl": (ascii_stl()[:-9], "breaks off after 36 facets"),
    "quad.stl": (ascii_stl().replace("  endloop", "   vertex 0 0 0\n  endloop", 1), "a facet has three vertices"),
    "word.stl": (ascii_stl().replace("outer", "inner", 1), "line 3, 'inner loop': this is no keyword of STL"),
    "two.stl": (ascii_stl().replace("vertex ", "vertex 1 ", 1), "line 4"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_file_is_refused_with_the_reason(name: str, tmp_path: Path) -> None:
    content, message = BAD[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SwarmError, match=message) as raised:
        read_mesh(path)
    assert str(path) in str(raised.value)
    craft = tmp_path / "craft.xml"
    craft.write_text(
        f'<mujoco><asset><mesh name="m" file="{name}"/></asset>'
        '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    with pytest.raises(SwarmError, match=message):
        load_craft(craft, passive=True)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match=r"none\.obj does not exist"):
        read_mesh(tmp_path / "none.obj")
    craft = tmp_path / "craft.xml"
    craft.write_text(
        '<mujoco><asset><mesh name="m" file="none.obj"/></asset>'
        '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    with pytest.raises(SwarmError, match=r"craft\.xml does not compile.*none\.obj"):
        load_craft(craft, passive=True)


@pytest.mark.skipif(not SPACECRAFT.is_dir(), reason="needs the meshes of real spacecraft")
def test_real_spacecraft_arrive_whole() -> None:
    for path in sorted(SPACECRAFT.glob("*.obj")):
        faces = [line.split()[1:] for line in path.read_text(errors="replace").splitlines() if line.startswith("f ")]
        _, face = surface(path)
        assert len(face) == sum(len(corners) - 2 for corners in faces), path.name
