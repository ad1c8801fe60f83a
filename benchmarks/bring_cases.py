"""A user's folder, tried from the command line: what is brought, and what must come of it.

Like `contradictions_cases`, whose plate and rig stand here before the camera again: each attempt
must give the right answer, or name what is wrong.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.contradictions_cases import (
    HOLES,
    PLATE,
    Attempt,
    Case,
    Plate,
    camera_info,
    depth_errors_mm,
    observe_attempt,
)
from benchmarks.rig import Rig, bit, lit, save, unlit
from exposight.cell import Cloud, write_cloud
from exposight.geometry import PinholeCamera


def clouds() -> list[Attempt]:
    """Organised, loose, and mutilated clouds of the plate."""
    plate = Plate()
    plate.write()
    rows, columns = plate.points.shape[:2]
    flat = plate.points.reshape(-1, 3)
    valid = np.isfinite(flat[:, 0])
    dense = flat[valid]
    lines = [" ".join(f"{x:.3f}" for x in point) for point in dense]
    size = f"obj_info num_cols {columns}\nobj_info num_rows {rows}\n"
    floats = "".join(f"property float {axis}\n" for axis in "xyz")

    def ply(name: str, vertices: int, body: bytes, head: str = "", tail: str = "") -> None:
        header = (
            f"ply\nformat ascii 1.0\n{head}element vertex {vertices}\n{floats}{tail}end_header\n"
        )
        Path(name).write_bytes(header.encode() + body)

    index = np.full(len(flat), -1)
    index[valid] = np.arange(len(dense))
    cells = "".join("0\n" if i < 0 else f"1 {i}\n" for i in index)
    body = ("\n".join(lines) + "\n" + cells).encode()
    tail = f"element range_grid {len(flat)}\nproperty list uchar int vertex_indices\n"
    ply("grid.ply", len(dense), body, size, tail)
    ply("grid-cut.ply", len(dense), body[: len(body) // 2], size, tail)
    ply("grid-wrong.ply", len(dense), body.replace(b"\n1 0\n", b"\n1 99999999\n"), size, tail)
    missing = "\n".join(
        " ".join("1.#QNAN" if np.isnan(x) else f"{x:.3f}" for x in point) for point in flat
    )
    ply("windows.ply", len(flat), (missing + "\n").encode(), size)
    ply("announced.ply", 10**9, b"1 2 3\n")
    text = {
        "blanks.xyz": "\n".join(lines),
        "count.pts": "\n".join([str(len(lines)), *(f"{line} 120 90 90 90" for line in lines)]),
        "semicolons.csv": "\n".join(["X;Y;Z", *(each.replace(" ", ";") for each in lines)]),
        "comma.txt": "\n".join(each.replace(".", ",") for each in lines),
        "excel.csv": "\n".join(
            ["X [mm];Y [mm];Z [mm]", *(e.replace(" ", ";").replace(".", ",") for e in lines)]
        ),
        "asc.asc": "\n".join(["# a scan", *lines]),
        "both.txt": "\n".join(each.replace(".", ",").replace(" ", ",") for each in lines[:999]),
        "two.xyz": "\n".join(each.rpartition(" ")[0] for each in lines[:999]),
        "ragged.xyz": "\n".join([*lines[:50], "1 2", *lines[50:99]]),
    }
    for name, content in text.items():
        Path(name).write_text(content + "\n")
    head = f"VERSION 0.6\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(dense)}\nHEIGHT 1\n"
    Path("old.pcd").write_text(head + f"POINTS {len(dense)}\nDATA ascii\n" + "\n".join(lines))
    for name in ("cloud.las", "cloud.zdf", "cloud.stl"):
        Path(name).write_bytes(b"x" * 200)
    good = ("grid.ply", "windows.ply", "blanks.xyz", "count.pts", "semicolons.csv", "comma.txt",
            "excel.csv", "asc.asc", "old.pcd")  # fmt: skip
    bad = {
        "grid-cut.ply": "cut off|announces",
        "grid-wrong.ply": "99999999|vertex|vertices",
        "announced.ply": "announces|cut off",
        "both.txt": "decimal",
        "two.xyz": "three|x, y|z|columns",
        "ragged.xyz": "line 51|row 51|51",
        "cloud.las": "las|ply",
        "cloud.zdf": "zdf|PLY|ply",
        "cloud.stl": "mesh|stl|STL",
    }
    return [
        *(observe_attempt(f"--cloud {name}", plate=plate) for name in good),
        *(observe_attempt(f"--cloud {name}", names=why) for name, why in bad.items()),
    ]


def features() -> list[Attempt]:
    """Bring lists of the plate's holes, and lists that cannot be."""
    plate = Plate()
    plate.write()

    def write(
        name: str,
        row: Callable[[str, float, float, float], list[object]],
        header: str,
        separator: str = ",",
        encoding: str = "utf-8",
    ) -> None:
        lines = [header.replace(",", separator)]
        for hole, (x, y, r) in HOLES.items():
            cells = [
                f"{c:g}".replace(".", "," if separator == ";" else ".")
                if isinstance(c, int | float)
                else str(c)
                for c in row(hole, x, y, r)
            ]
            lines.append(separator.join(cells))
        Path(name).write_bytes(("\r\n".join(lines) + "\r\n").encode(encoding))

    own = "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm"
    write("excel.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, 1, r], own, ";", "utf-8-sig")
    write("cp1252.csv", lambda n, x, y, r: [n, "Bohrung", x, y, 0, 0, 0, 1, 2 * r],
          "Merkmal,Art,X [mm],Y [mm],Z [mm],I,J,K,Ø [mm]", ";", "cp1252")  # fmt: skip
    write("utf16.txt", lambda n, x, y, r: [n, "Kreis", x, y, 0, 0, 0, 1, r],
          "Name,Typ,X [mm],Y [mm],Z [mm],nx,ny,nz,Radius [mm]", "\t", "utf-16")  # fmt: skip
    write("diameter.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, 1, 2 * r],
          own.replace("radius_mm", "diameter_mm"))  # fmt: skip
    write("extra.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, 1, r, 0.1], own + ",tolerance")
    write("size.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, 1, r],
          own.replace("radius_mm", "size_mm"))  # fmt: skip
    write("inward.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, -1, r], own)
    write("twice.csv", lambda n, x, y, r: ["h1", "hole", x, y, 0, 0, 0, 1, r], own)
    write("inches.csv", lambda n, x, y, r: [n, "hole", x / 25.4, y / 25.4, 0, 0, 0, 1, r / 25.4],
          own)  # fmt: skip
    write("metres.csv", lambda n, x, y, r: [n, "hole", x / 1e3, y / 1e3, 0, 0, 0, 1, r / 1e3], own)
    write("radius.csv", lambda n, x, y, r: [n, "hole", x, y, 0, 0, 0, 1, 2 * r], own)
    write("no-normal.csv", lambda n, x, y, r: [n, "hole", x, y, 0, r], "name,kind,x_mm,y_mm,z_mm,"
          "radius_mm")  # fmt: skip
    write("words.csv", lambda n, x, y, r: [n, "hole", x, "?", 0, 0, 0, 1, r], own)
    circles = [f"F({n})=FEAT/CIRCLE,INNER,CART,{x},{y},0,0,0,1,{2 * r}"
               for n, (x, y, r) in HOLES.items()]  # fmt: skip
    Path("cmm.dmi").write_text("\n".join(["UNITS/MM,ANGDEC", *circles, ""]))
    Path("nothing.dmi").write_text("UNITS/MM,ANGDEC\nF(P)=FEAT/PLANE,CART,0,0,0,0,0,1\n")
    good = ("excel.csv", "cp1252.csv", "utf16.txt", "diameter.csv", "extra.csv", "cmm.dmi")
    bad = {
        "size.csv": "size=",
        "inward.csv": "inward|normal",
        "twice.csv": "twice|h1",
        "inches.csv": "inch|pixel|mm",
        "metres.csv": "metres| m|pixel",
        "no-normal.csv": "normal|nx",
        "words.csv": r"\?",
        "nothing.dmi": "circle|CIRCLE|feature",
    }
    return [
        *(observe_attempt(f"--features {name}", plate=plate) for name in good),
        *(observe_attempt(f"--features {name}", names=why) for name, why in bad.items()),
        observe_attempt("--features size.csv --read-as size=radius", plate=plate),
        observe_attempt("--features inward.csv --read-as normals=inward", plate=plate),
        observe_attempt("--features radius.csv", names="diameter|radius"),
    ]


def robots() -> list[Attempt]:
    """Give the plate's pose as robots print it, and wrongly."""
    plate = Plate()
    plate.write()
    matrix = PLATE.to_matrix()
    place, turn = matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3])
    wxyz = np.roll(turn.as_quat(), 1)
    abc, wpr = turn.as_euler("ZYX", degrees=True), turn.as_euler("xyz", degrees=True)
    vector = turn.as_rotvec()

    def numbers(*values: float) -> str:
        return ",".join(f"{x:.6f}" for x in values)

    frame = "{{X {:.4f},Y {:.4f},Z {:.4f},A {:.5f},B {:.5f},C {:.5f}}}".format(*place, *abc)
    metres = numbers(*(place / 1000), *vector)
    comma = ", ".join(f"{x:.6f}".replace(".", ",") for x in (*(place / 1000), *vector))
    target = f"[[{numbers(*place)}],[{numbers(*wxyz)}],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09]]"
    np.savetxt("transposed.txt", matrix.T)
    np.savetxt("inverse.txt", np.linalg.inv(matrix))
    small = matrix.copy()
    small[:3, 3] /= 1000
    np.savetxt("metres.txt", small)
    Path("twelve.txt").write_text("\n".join(" ".join(map(repr, map(float, r))) for r in matrix[:3]))
    Path("seven.txt").write_text(numbers(*place, *wxyz))
    rows = ", ".join("[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in matrix)
    Path("zivid.yaml").write_text(
        f"__version__:\n  serializer: 1\nFloatMatrix:\n  Data: [{rows}]\n"
    )
    Path("program.src").write_text(
        f"DEF scan()\nDECL E6POS XHOME={{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nDECL E6POS XP1={frame}\nEND\n"
    )

    def robot(notation: str, text: str, names: str = "", *, right: bool = True) -> Attempt:
        return observe_attempt(f"--robot-pose {notation} '{text}'", names, plate if right else None)

    return [
        robot("kuka", frame),
        robot("kuka", numbers(*place, *abc)),
        robot("abb", target),
        robot("abb", numbers(*place, *wxyz)),
        robot("abb", numbers(*place, *wxyz[1:], wxyz[0]), "xyzw|order|quaternion", right=False),
        robot("ur", f"p[{metres}]"),
        robot("ur", f"p[{comma}]"),
        robot("ur", numbers(*place, *vector), " mm|millimet|metre", right=False),
        robot("ur", numbers(*(place / 1000), *np.degrees(vector)), "degrees|rad|π", right=False),
        robot("fanuc", numbers(*place, *wpr)),
        robot("fanuc", numbers(*place, *np.radians(wpr)), "rad|degrees", right=False),
        robot("fanuc", numbers(*place, *abc), "kuka|order|behind|away|face", right=False),
        observe_attempt("--pose transposed.txt", "transposed", plate),
        observe_attempt("--pose metres.txt", "metres| m"),
        observe_attempt("--pose inverse.txt", "inverse|invert"),
        observe_attempt("--pose twelve.txt", plate=plate),
        observe_attempt("--pose zivid.yaml", plate=plate),
        observe_attempt("--pose seven.txt", "wxyz"),
        observe_attempt("--pose seven.txt --read-as quaternion=wxyz", plate=plate),
        observe_attempt("--pose program.src", "XP1|several|2 poses"),
        observe_attempt("--pose program.src#XP1", plate=plate),
    ]


def chains() -> list[Attempt]:
    """Give the flange in the base, the camera on the flange, the part in the base."""
    plate = Plate()
    plate.write()
    hand_eye, flange = np.eye(4), np.eye(4)
    hand_eye[:3, :3] = Rotation.from_euler("xyz", [2, -4, 91], degrees=True).as_matrix()
    hand_eye[:3, 3] = (35, -80, 110)
    flange[:3, :3] = Rotation.from_euler("ZYX", [25, 8, 168], degrees=True).as_matrix()
    flange[:3, 3] = (850, -310, 1050)
    part = flange @ hand_eye @ PLATE.to_matrix()
    for name, matrix in (
        ("hand_eye.txt", hand_eye),
        ("eye_hand.txt", np.linalg.inv(hand_eye)),
        ("part.txt", part),
        ("flange.txt", flange),
    ):
        np.savetxt(name, matrix)
    abc = Rotation.from_matrix(flange[:3, :3]).as_euler("ZYX", degrees=True)
    printed = "{{X {:.4f},Y {:.4f},Z {:.4f},A {:.5f},B {:.5f},C {:.5f}}}".format(
        *flange[:3, 3], *abc
    )
    Path("flange.src").write_text(f"DECL E6POS XP1={printed}\n")
    chain = "--hand-eye hand_eye.txt --part-pose part.txt"
    return [
        observe_attempt(f"--flange flange.txt {chain}", plate=plate),
        observe_attempt(f"--flange flange.src {chain}", plate=plate),
        observe_attempt("--flange flange.txt --hand-eye hand_eye.txt", "--part-pose|part"),
        observe_attempt("--flange flange.txt --hand-eye eye_hand.txt --part-pose part.txt",
                        "hand-eye|hand_eye|inverse|invert"),
    ]  # fmt: skip


def tables() -> list[Attempt]:
    """Tables to train on, as pandas and Excel write them, and in wrong units."""
    rng = np.random.default_rng(3)
    names = [
        "feature",
        "view",
        "exposure_ms",
        "p_norm",
        "i_avg",
        "x_mm",
        "y_mm",
        "z_mm",
        "w_deg",
        "p_deg",
        "r_deg",
        "radius_mm",
    ]
    rows: list[list[float | str]] = []
    for view in range(12):
        for hole in range(6):
            x, y, z = rng.uniform(-80, 80, 3) * (1, 0.7, 0.5)
            w, p = rng.uniform(-15, 15, 2)
            for time_ms in (5.0, 10.0, 20.0, 40.0):
                grey = 2.2 * time_ms * (1 - 0.004 * abs(x)) * np.cos(np.radians(w))
                good = 1 / (1 + np.exp((14 - grey) / 3)) / (1 + np.exp((grey - 150) / 14))
                rows.append([f"h{hole}", f"v{view:02d}", time_ms, round(float(good), 4),
                             round(float(min(grey, 255)), 2), *map(float, np.round((x, y, z), 2)),
                             *map(float, np.round((w, p), 2)), 0.0, 6.0])  # fmt: skip

    def write(name: str, separator: str = ",", decimal: str = ".", encoding: str = "utf-8",
              index: bool = False, missing: str = "", **factors: float) -> None:  # fmt: skip
        lines = [separator.join([*([""] if index else []), *names])]
        for i, row in enumerate(rows):
            cells = [str(i)] if index else []
            for column, value in zip(names, row, strict=True):
                if missing and i % 17 == 0 and column in {"p_norm", "i_avg"}:
                    cells.append(missing)
                elif isinstance(value, str):
                    cells.append(value)
                else:
                    factor = factors.get(column, 1.0)
                    cells.append(repr(round(value * factor, 7)).replace(".", decimal))
            lines.append(separator.join(cells))
        Path(name).write_bytes(("\n".join(lines) + "\n").encode(encoding))

    angle = float(np.pi / 180)
    write("good.csv")
    write("index.csv", index=True)
    write("excel.csv", ";", ",", "utf-8-sig")
    write("nan.csv", missing="nan")
    write("na.csv", missing="NA")
    write("seconds.csv", exposure_ms=0.001)
    write("microseconds.csv", exposure_ms=1000.0)
    write("percent.csv", p_norm=100.0)
    write("percent-small.csv", p_norm=9.0)
    write("radians.csv", w_deg=angle, p_deg=angle)
    write("metres.csv", x_mm=0.001, y_mm=0.001, z_mm=0.001, radius_mm=0.001)
    write("grey12.csv", i_avg=16.0)

    def train(name: str, names: str = "", *, right: bool = False) -> Attempt:
        folder = f"models-{Path(name).stem}"
        call = f"train {name} --model q_k1 --output {folder}"
        return Attempt(
            call=call, names=names, right=(lambda: any(Path(folder).iterdir())) if right else None
        )

    return [
        *(
            train(name, right=True)
            for name in ("good.csv", "index.csv", "excel.csv", "nan.csv", "na.csv")
        ),
        train("seconds.csv", r"\bs\b|second"),
        train("microseconds.csv", "µs|us|micro"),
        train("percent.csv", "percent"),
        train("percent-small.csv", "percent|p_norm"),
        train("radians.csv", "rad"),
        train("metres.csv", "metres"),
        train("grey12.csv", "grey"),
    ]


def calibrations() -> list[Attempt]:
    """Cameras of which the saved size, kind or place is wrong."""
    plate = Plate()
    plate.write()
    camera = plate.camera
    base = Path("camera.yaml").read_text()
    Path("fisheye.yaml").write_text(base.replace("plumb_bob", "equidistant"))
    Path("cut.yaml").write_text(base[: len(base) // 3])
    Path("rows.yaml").write_text(base.replace("rows: 3\n  cols: 3\n  data: [800", "rows: 3\n"
                                              "  cols: 9\n  data: [800"))  # fmt: skip
    Path("text.yaml").write_text("this is no calibration\n")
    Path("empty.yaml").write_text("")
    camera_info("usual.yaml", PinholeCamera(width=640, height=480, fx=800.0, fy=800.0, cx=319.5,
                                            cy=239.5))  # fmt: skip
    Path("flat.json").write_text(
        json.dumps(
            {"K": np.ravel(camera.matrix).tolist(), "D": [0.0] * 5, "width": 640, "height": 480}
        )
    )
    sensor = "--name cam --exposures 0.1 100 --working-distance 300 700"

    def describe(call: str, names: str = "", *, right: bool = False) -> Attempt:
        def is_written() -> bool:
            text = Path("out.json").read_text() if Path("out.json").is_file() else ""
            Path("out.json").unlink(missing_ok=True)
            return "800" in text

        return Attempt(
            call=f"sensor {call} {sensor} -o out.json", names=names,
            right=is_written if right else None,
        )  # fmt: skip

    angle = 2 * np.degrees(np.arctan(320 / 800)), 2 * np.degrees(np.arctan(240 / 800))
    return [
        describe("usual.yaml", right=True),
        describe("flat.json", right=True),
        describe("fisheye.yaml", "equidistant|fisheye"),
        describe("cut.yaml", "cut.yaml"),
        describe("rows.yaml", "27|9|3×3|rows"),
        describe("text.yaml", "text.yaml"),
        describe("empty.yaml", "empty"),
        describe("nowhere.yaml", "no such"),
        describe(
            f"--resolution 640 480 --field-of-view-deg {angle[0]:.6f} {angle[1]:.6f}", right=True
        ),
    ]


def frames() -> list[Attempt]:
    """Stripe frames with other names, types and numbers of files."""
    rig = Rig()
    rig.calibration(Path("calibration.yml"))
    stack = [rig.frame(lit), rig.frame(unlit)]
    stack += [rig.frame(bit(k, 10)) for k in range(10)]
    head = (
        'name = "gray"\nprojector_width = 1024\nprojector_height = 768\nwhite_frame = 0\n'
        "black_frame = 1\n"
    )
    code = f"\n[columns.gray_code]\nframes = {list(range(2, 12))}\n"
    Path("png.toml").write_text(head + code)
    save(Path("plus"), [*stack, stack[0]])
    save(Path("gap"), stack)
    (Path("gap") / "frame_05.png").unlink(missing_ok=True)
    kinds = {"bmp": ".BMP", "tiff": ".TIF", "jpeg": ".jpg"}
    for name, suffix in kinds.items():
        Path(name).mkdir()
        pattern = {"bmp": "*.bmp", "tiff": "*.tif", "jpeg": "*.JPG"}[name]
        Path(f"{name}.toml").write_text(head + f'file_pattern = "{pattern}"\n' + code)
        for i, frame in enumerate(stack):
            data = cv2.imencode(suffix.lower(), frame.astype(np.uint8))[1]
            (Path(name) / f"IMG_{i + 1}{suffix}").write_bytes(data.tobytes())
    save(Path("wrong-suffix"), stack)
    for file in Path("wrong-suffix").iterdir():
        file.rename(file.with_suffix(".bmp"))

    def is_right() -> bool:
        off = depth_errors_mm(rig) if Path("cloud.ply").is_file() else np.array([9.0])
        return bool(np.median(off) < 1.5)

    def decode(folder: str, sequence: str, names: str = "", *, right: bool = False) -> Attempt:
        call = f"decode {folder} -c calibration.yml -s {sequence} -o cloud.ply"
        return Attempt(call=call, names=names, right=is_right if right else None)

    return [
        decode("plus", "png.toml", "13|12"),
        decode("gap", "png.toml", "11|12|05|gap"),
        decode("bmp", "bmp.toml", right=True),
        decode("tiff", "tiff.toml", right=True),
        decode("jpeg", "jpeg.toml", right=True),
        decode("wrong-suffix", "bmp.toml", right=True),
    ]


def collected() -> list[Attempt]:
    """Collect a scanner's folder as a campaign, and what may be wrong with it."""
    plate = Plate()
    plate.write()
    for folder in ("scan", "unit", "strange", "empty", "twice"):
        Path(folder).mkdir()
    for view in (1, 2):
        for time_ms in (5, 10):
            for folder, name in (
                ("scan", f"P{view:02d}_{time_ms}ms"),
                ("unit", f"P{view:02d}_{time_ms}"),
                ("twice", f"P{view:02d}_{time_ms}ms"),
            ):
                grey = plate.image.astype(float) * time_ms / 10
                cv2.imwrite(f"{folder}/{name}.png", np.clip(grey, 0, 255).astype(np.uint8))
                write_cloud(Path(folder) / f"{name}.ply", Cloud(points=plate.points))
    cv2.imwrite("twice/P01_05ms.png", plate.image)
    write_cloud(Path("twice/P01_05ms.ply"), Cloud(points=plate.points))
    Path("strange/readme.txt").write_text("nothing here\n")
    rows = "\n".join(
        f"P{v:02d};" + ";".join(f"{x:.6f}".replace(".", ",") for x in (
            *PLATE.translation_mm,
            *Rotation.from_matrix(PLATE.rotation).as_euler("xyz", degrees=True)))
        for v in (1, 2)
    )  # fmt: skip
    Path("poses.csv").write_text("name;x_mm;y_mm;z_mm;w_deg;p_deg;r_deg\n" + rows.replace("P", "")
                                 + "\n")  # fmt: skip
    usual = "--features features.csv --sensor sensor.json --pose pose.txt"

    def collect(folder: str, options: str, names: str = "", *, right: bool = False) -> Attempt:
        out = f"campaign-{folder}"

        def is_right() -> bool:
            return (Path(out) / "campaign.json").is_file() and (
                len(list((Path(out) / "captures").glob("[0-9]*"))) == 4
            )

        call = f"collect {folder} -o {out} {options}"
        return Attempt(call=call, names=names, right=is_right if right else None)

    usual = usual.replace("--pose pose.txt", "--poses pose.txt")
    named = "--name P{view}_{exposure}ms"
    return [
        collect("scan", f"{named} {usual}", right=True),
        collect("scan", f"{named} {usual}", right=True),  # again: it goes on, and nothing is new
        collect("unit", f"--name P{{view}}_{{exposure}} {usual}", "exposure=|unit|ms"),
        collect("strange", f"{named} {usual}", "strange|no image"),
        collect("empty", f"{named} {usual}", "empty|no image"),
        collect("twice", f"{named} {usual}", "twice|05ms|5 ms"),
        collect("nowhere", f"{named} {usual}", "nowhere"),
    ]


CASES: Mapping[str, Case] = MappingProxyType(
    {
        "10 calibrations": calibrations,
        "11-13, 15 clouds": clouds,
        "19 robots' poses": robots,
        "20 chains of poses": chains,
        "21 lists of features": features,
        "22 tables": tables,
        "23 frames": frames,
        "a scanner's folder": collected,
    }
)
