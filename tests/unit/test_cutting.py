"""The fin to cut: what is drawn, read back by programs that share nothing with the writers, to 0.01 mm."""

from __future__ import annotations

import ctypes
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import pypdfium2 as pdfium
import pypdfium2.raw as pdfium_c
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from svgelements import SVG, Circle, Polygon, SimpleLine

from fin_optimizer.commands import export_fin
from fin_optimizer.cutting.blank import Blank, Clamp, blank
from fin_optimizer.cutting.dxf import write_dxf
from fin_optimizer.cutting.pdf import CONTROL, MARGIN, write_pdf
from fin_optimizer.cutting.sheet import Layout, fitting, nested
from fin_optimizer.cutting.svg import write_svg
from fin_plant.fin import Fin, ProfiledFin

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

STUDY = Path(__file__).parents[1] / "data" / "study_2026_11"
PROFILED = ProfiledFin(
    length=0.0963,
    height=0.0217,
    tip_height=0.0351,
    thickness=0.00035,
    profile_position=(0.3, 0.7),
    profile_height=(0.018, 0.0264),
)
CORNERS = np.array([
    (-12.0, -10.85), (0.0, -10.85), (28.89, -9.0), (67.41, -13.2), (96.3, -17.55),
    (96.3, 17.55), (67.41, 13.2), (28.89, 9.0), (0.0, 10.85), (-12.0, 10.85),
])  # fmt: skip
"""mm, worked out by hand from `PROFILED` with a clamp of 12 mm."""
CLAMP = Clamp(12.0, 2, 3.2)
HOLES = np.array([(-6.0, -21.7 / 6.0), (-6.0, 21.7 / 6.0)])
EXACT = 0.01  # mm
_MM = 25.4 / 72.0
A_SHEET = ((300.0, 200.0), 5.0)


def drawn() -> Layout:
    return fitting([blank(PROFILED, CLAMP, ("trial 0007", "PET_0.35"))], 16.0)


def two() -> Layout:
    return nested([blank(PROFILED, CLAMP, ("a",)), blank(Fin(), Clamp(0.0), ("b",))], *A_SHEET)


def moved(points: NDArray[np.float64], layout: Layout, piece: int = 0) -> NDArray[np.float64]:
    return np.add(points, layout.pieces[piece].at)


def same_ring(found: NDArray[np.float64], expected: NDArray[np.float64]) -> bool:
    """Whether a closed line has these corners, from whichever it begins and in whichever sense it runs."""
    ring = found[:-1] if np.allclose(found[0], found[-1], atol=EXACT) else found
    if ring.shape != expected.shape:
        return False
    turns = [np.roll(way, start, axis=0) for way in (ring, ring[::-1]) for start in range(len(ring))]
    return any(np.allclose(turn, expected, rtol=0.0, atol=EXACT) for turn in turns)


def dxf_layers(path: Path) -> dict[str, list[tuple[str, Any]]]:
    """Read a DXF with GDAL: geometry type and points by layer."""
    _, _, geometries, fields = pyogrio.raw.read(path, columns=["Layer"])
    found: dict[str, list[tuple[str, Any]]] = {}
    for well_known, layer in zip(geometries, fields[0], strict=True):
        found.setdefault(layer, []).append(points_of(bytes(well_known)))
    return found


def points_of(data: bytes) -> tuple[str, Any]:
    """Return kind and points of a point or line, flat or in space, as GDAL's well-known binary."""
    order = "<" if data[0] else ">"
    code = int(np.frombuffer(data, f"{order}u4", 1, 1)[0])
    size = 3 if code & 0x80000000 else 2
    if code & 0xFF == 1:
        return "point", np.frombuffer(data, f"{order}f8", size, 5)[:2]
    assert code & 0xFF == 2
    count = int(np.frombuffer(data, f"{order}u4", 1, 5)[0])
    return "line", np.frombuffer(data, f"{order}f8", size * count, 9).reshape(count, size)[:, :2]


def test_a_foreign_reader_of_dxf_gets_the_outline_back(tmp_path: Path) -> None:
    layout, path = drawn(), tmp_path / "fin.dxf"
    write_dxf(path, layout)
    layers = dxf_layers(path)
    lines = [points for kind, points in layers["CUT"] if kind == "line"]
    outline, *circles = sorted(lines, key=lambda points: -np.ptp(points[:, 0]))
    assert same_ring(outline, moved(CORNERS, layout))
    middles = np.array(sorted(np.mean([circle.min(axis=0), circle.max(axis=0)], axis=0).tolist() for circle in circles))
    assert middles == pytest.approx(moved(HOLES, layout), abs=EXACT)
    assert all(np.ptp(circle[:, 0]) == pytest.approx(3.2, abs=EXACT) for circle in circles)
    ((_, root),) = layers["SCORE"]
    assert root == pytest.approx(moved(np.array([(0.0, -10.85), (0.0, 10.85)]), layout), abs=EXACT)
    assert layers["TEXT"]
    assert layers["DIMENSION"]


def test_a_dxf_says_that_it_is_in_millimetres(tmp_path: Path) -> None:
    write_dxf(tmp_path / "fin.dxf", drawn())
    tags = [line.strip() for line in (tmp_path / "fin.dxf").read_text().splitlines()]
    assert tags[tags.index("$MEASUREMENT") + 2] == "1"
    assert tags[tags.index("$INSUNITS") + 2] == "4"
    for text in ("trial 0007", "PET_0.35"):
        assert text in tags


def test_a_foreign_reader_of_svg_gets_the_outline_back_in_millimetres(tmp_path: Path) -> None:
    layout, path = two(), tmp_path / "fins.svg"
    write_svg(path, layout)
    svg = SVG.parse(path, ppi=25.4)  # one dot is 1 mm
    assert (svg.width, svg.height) == pytest.approx((300.0, 200.0))

    def up(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([points[:, 0], 200.0 - points[:, 1]])

    _, first, second = (
        up(np.array([(p.x, p.y) for p in each])) for each in svg.elements() if isinstance(each, Polygon)
    )
    assert same_ring(first, moved(CORNERS, layout))
    plain = np.array([(0.0, -12.5), (80.0, -12.5), (80.0, 12.5), (0.0, 12.5)])
    assert same_ring(second, moved(plain, layout, 1))
    circles = [each for each in svg.elements() if isinstance(each, Circle)]
    assert up(np.array([(each.cx, each.cy) for each in circles])) == pytest.approx(moved(HOLES, layout), abs=EXACT)
    assert len([each for each in svg.elements() if isinstance(each, SimpleLine)]) == 1, "a fin without a tab has none"


def pdf_paths(path: Path) -> tuple[tuple[float, float], list[NDArray[np.float64]]]:
    """Read a PDF with PDFium: page size, and the points of every path on it, both in mm from the lower left corner."""
    document = pdfium.PdfDocument(path)
    page = document[0]
    paths = []
    for each in page.get_objects(filter=[pdfium_c.FPDF_PAGEOBJ_PATH]):
        matrix = each.get_matrix()
        points = []
        for number in range(pdfium_c.FPDFPath_CountSegments(each)):
            x, y = ctypes.c_float(), ctypes.c_float()
            segment = pdfium_c.FPDFPath_GetPathSegment(each, number)
            pdfium_c.FPDFPathSegment_GetPoint(segment, x, y)
            points.append(matrix.on_point(x.value, y.value))
        paths.append(np.array(points) * _MM)
    size = tuple(edge * _MM for edge in page.get_size())
    document.close()
    return (size[0], size[1]), paths


def test_a_foreign_reader_of_pdf_gets_the_outline_back_on_a_page_at_one_to_one(tmp_path: Path) -> None:
    layout, path = drawn(), tmp_path / "fin.pdf"
    write_pdf(path, layout)
    size, paths = pdf_paths(path)
    assert size == pytest.approx((210.0, 297.0), abs=0.1)
    rings = [points - points.min(axis=0) for points in paths if len(points) in {10, 11}]
    assert any(same_ring(ring, CORNERS - CORNERS.min(axis=0)) for ring in rings)
    spans = [np.ptp(points, axis=0) for points in paths if len(points) == 2]
    assert any(span == pytest.approx((CONTROL, 0.0), abs=EXACT) for span in spans)
    everything = np.vstack([points for points in paths if len(points) < 12])
    assert everything.min() >= MARGIN - EXACT, "nothing lies where a printer may not print"


def test_a_layout_larger_than_a3_is_no_page(tmp_path: Path) -> None:
    long = nested([blank(Fin(), Clamp())], (420.0, 100.0), 5.0)
    with pytest.raises(ValueError, match=r"420 x 100 mm does not fit on a page of A3 at 1:1: write DXF or SVG"):
        write_pdf(tmp_path / "fin.pdf", long)
    assert list(tmp_path.iterdir()) == []


def boxes(layout: Layout) -> NDArray[np.float64]:
    corners = [np.array([piece.point(corner) for corner in piece.blank.outline]) for piece in layout.pieces]
    return np.array([[*points.min(axis=0), *points.max(axis=0)] for points in corners])


SIZES = st.lists(
    st.tuples(st.floats(20.0, 150.0), st.floats(5.0, 60.0), st.sampled_from([0.0, 8.0])), min_size=1, max_size=12
)


@given(SIZES, st.floats(0.0, 8.0))
@settings(max_examples=60)
def test_no_fin_on_a_sheet_is_nearer_to_another_or_to_the_edge_than_the_gap(
    sizes: list[tuple[float, float, float]], gap: float
) -> None:
    blanks = [
        blank(Fin(length=1e-3 * length, height=1e-3 * height, tip_height=5e-3), Clamp(clamp))
        for length, height, clamp in sizes
    ]
    layout = nested(blanks, (400.0, 600.0), gap)
    found = boxes(layout)
    assert [piece.blank for piece in layout.pieces] == blanks
    assert found[:, :2].min() >= gap - 1e-6
    assert (found[:, 2:] <= np.array([400.0, 600.0]) - gap + 1e-6).all()
    for number, one in enumerate(found):
        for other in found[number + 1 :]:
            apart = max(other[0] - one[2], one[0] - other[2], other[1] - one[3], one[1] - other[3])
            assert apart >= gap - 1e-6


def plain(length: float, height: float) -> Blank:
    return blank(Fin(length=1e-3 * length, height=1e-3 * height, tip_height=1e-3 * height), Clamp(0.0))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: nested([plain(140, 30)], (120.0, 200.0), 5.0),
         "140 x 30 mm with 5 mm around it needs 150 x 40 mm and does not fit on a sheet of 120 x 200 mm: turn the"),
        (lambda: nested([plain(140, 30)], (120.0, 45.0), 5.0), "120 x 45 mm: give a larger sheet"),
        (lambda: nested([plain(90, 30)] * 5, (210.0, 100.0), 5.0),
         "holds 4 of the 5 fins with 5 mm around each, all lying alike: give a larger sheet or fewer fins"),
        (lambda: nested([plain(90, 30)], (float("nan"), 100.0), 5.0), "sheet's length"),
        (lambda: Clamp(4.0, 1, 3.0), "a clamp of 4 mm has no room for holes of 3 mm: at least 1 mm of sheet"),
        (lambda: Clamp(-1.0), "clamp = -1 mm"),
        (lambda: blank(Fin(height=0.01), Clamp(10.0, 3, 3.0)),
         "a root of 10 mm has no room for 3 holes of 3 mm: it must be 16 mm or more"),
    ],
)  # fmt: skip
def test_what_cannot_be_cut_is_refused_with_its_numbers(make: Callable[[], object], said: str) -> None:
    with pytest.raises(ValueError, match=r".") as refused:
        make()
    assert said in str(refused.value)


def test_the_best_fins_of_a_study_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = tmp_path / "study"
    shutil.copytree(STUDY, study)
    assert export_fin.main([str(study)]) == 0
    assert {path.name for path in study.glob("fin.*")} == {"fin.dxf", "fin.svg", "fin.pdf"}
    assert capsys.readouterr().out.splitlines()[0] == "trial 0001, 1.505 cm/s, 80 x 25 x 0.208 mm"
    sheet = tmp_path / "sheets" / "three.svg"
    assert export_fin.main([str(study), "--best", "3", "--sheet", "21cm x 100", "--out", str(sheet)]) == 0
    assert "trial 0000" in sheet.read_text()
    assert export_fin.main([str(study), "--trial", "2", "--out", str(tmp_path / "two.dxf")]) == 0
    assert capsys.readouterr().out.splitlines()[-2] == "trial 0002, 1.374 cm/s, 80 x 25 x 0.208 mm"


def test_a_fin_of_given_sizes_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "fin.svg"
    sizes = ["fin.length=96mm", "fin.height=2.1cm", "fin.profile_position=0.5", "fin.profile_height=18mm"]
    assert export_fin.main([*sizes, "--clamp", "0", "--out", str(path)]) == 0
    assert "96 x 21 x 0.208 mm" in path.read_text()
    (polygon,) = (each for each in SVG.parse(path, ppi=25.4).elements() if isinstance(each, Polygon))
    points = np.array([(p.x, p.y) for p in polygon])
    assert np.ptp(points, axis=0) == pytest.approx((96.0, 21.0), abs=EXACT)
    assert np.ptp(points[np.isclose(points[:, 0], points[:, 0].min() + 48.0), 1]) == pytest.approx(18.0, abs=EXACT)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere"),
        (["fin.lenght=8cm"], "'fin.lenght=8cm' is no size of a fin: write NAME=VALUE with one of fin.length"),
        (["fin.length=80"], "fin.length"),
        (["fin.length=8cm", "study"], "give one study, or sizes"),
        (["fin.length=8cm", "--sheet", "210"], "sheet '210' must read LENGTHxWIDTH"),
        (["fin.length=8cm", "--clamp", "2 kg"], "clamp = '2 kg' has another kind of unit"),
        (["fin.length=8cm", "--out", "fin.png"], "a drawing's name must end in .dxf, .svg, .pdf"),
        (["fin.length=8cm", "--sheet", "600x500", "--out", "a.svg", "--out", "a.pdf"], "does not fit on a page of A3"),
        ([str(STUDY), "--trial", "99"], "the study has no trial 0099: its last one is trial 0002"),
        ([str(STUDY), "--best", "0"], "best"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert export_fin.main(words) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_sheet_of_the_stock_is_what_its_fins_are_cut_from() -> None:
    fin = export_fin.Wanted(Fin(length=0.09), ("a", "PP_0.5"), (210.0, 297.0))
    layout = export_fin.laid_out([fin, replace(fin, words=("b",))], Clamp(), None, 5.0)
    assert (layout.width, layout.height) == (297.0, 210.0)
    other = replace(fin, sheet=(120.0, 45.0))
    assert export_fin.laid_out([fin, other], Clamp(), None, 5.0).width == pytest.approx(110.0), "of two sheets"
