"""One camera, one rig and one stereo pair, as dozens of programs write them: the same numbers."""

import io
import json

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from exposight.errors import AmbiguousError, ContradictionError, FormatError, InputError
from exposight.files.reading import Reading, collected_remarks, reading_as
from exposight.geometry import CalibrationKeys, RigidTransform, read_calibration

K = np.array([[2210.5, 0, 811.25], [0, 2212.0, 622.5], [0, 0, 1]])
D = np.array([-0.0812, 0.1334, 0.0004, -0.0011, 0.025])
KP = np.array([[1890.0, 0, 634.0], [0, 1893.5, 752.0], [0, 0, 1]])
DP = np.array([0.012, -0.08, 0.0002, 0.0005, 0.0])
R = RigidTransform.from_fanuc_wpr((0, 0, 0), 0.0, 14.0, 0.0).rotation
T = np.array([-118.5, 3.2, 21.0])
MOTION = np.block([[R, T[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
BACK = np.linalg.inv(MOTION)
SIZE, PROJECTOR_SIZE = (1624, 1240), (1280, 800)


def opencv(**nodes):
    """As OpenCV writes YAML."""
    lines = ["%YAML:1.0", "---"]
    for name, value in nodes.items():
        if np.ndim(value) == 0:
            lines.append(f"{name}: {value}")
            continue
        rows = np.atleast_2d(value)
        data = ", ".join(f"{int(x)}." if x == int(x) else repr(float(x)) for x in rows.ravel())
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows.shape[0]}",
                  f"   cols: {rows.shape[1]}", "   dt: d", f"   data: [ {data} ]"]  # fmt: skip
    return "\n".join(lines) + "\n"


def lists(value):
    """The same with lists for arrays."""
    if isinstance(value, dict):
        return {key: lists(each) for key, each in value.items()}
    if isinstance(value, list):
        return [lists(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def dumped(**nodes):
    return yaml.safe_dump(lists(nodes), sort_keys=False)


def in_json(**nodes):
    return json.dumps(lists(nodes))


def rows_of(matrix, separator=" "):
    return "\n".join(separator.join(map(repr, map(float, row))) for row in np.atleast_2d(matrix))


def archive(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def matlab_file(**content):
    file = io.BytesIO()
    savemat(file, content, do_compression=True)
    return file.getvalue()


def matlab(k, d, *, new=False):
    """MATLAB's cameraParameters, pixels counted from 1."""
    one = k + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    return {
        ("K" if new else "IntrinsicMatrix"): one if new else one.T,
        "RadialDistortion": np.array([d[0], d[1], d[4]]),
        "TangentialDistortion": np.array([d[2], d[3]]),
        "ImageSize": np.array([1240.0, 1624.0]),
    }


def named(k=K):
    return {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}


SIZES = {"image_width": 1624, "image_height": 1240}
OST = (
    "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n1624\n\nheight\n1240\n\n[{name}]\n\n"
    f"camera matrix\n{rows_of(K)}\n\ndistortion\n{rows_of(D)}\n\n"
    "rectification\n1 0 0\n0 1 0\n0 0 1\n\n"
    "projection\n2100.0 0.0 800.0 {offset}\n0.0 2100.0 620.0 0.0\n0.0 0.0 1.0 0.0\n\n"
)
REALSENSE = {"width": 1624, "height": 1240, "ppx": 811.25, "ppy": 622.5, "fx": 2210.5,
             "fy": 2212.0, "model": "distortion.brown_conrady", "coeffs": D}  # fmt: skip
RC_PARAM = (
    "# Created by gc_stream\ncamera.A=[2210.5 0 811.25; 0 2212.0 622.5; 0 0 1]\n"
    "camera.height=1240\ncamera.width=1624\ncamera.k1=-0.0812\ncamera.k2=0.1334\n"
    "camera.p1=0.0004\ncamera.p2=-0.0011\ncamera.k3=0.025\nrho=353.68\nt=0.16\n"
)
ZIVID = {
    "__version__": {"serializer": 1, "data": 2},
    "CameraIntrinsics": {
        "CameraMatrix": {"CX": 811.25, "CY": 622.5, "FX": 2210.5, "FY": 2212.0},
        "Distortion": {"K1": -0.0812, "K2": 0.1334, "K3": 0.025, "P1": 0.0004, "P2": -0.0011},
    },
}
ENSENSO = {"Calibration": {"Monocular": {"Left": {"Camera": K.T, "Distortion": D}}}}

ONE_CAMERA = {
    "opencv.yml": opencv(camera_matrix=K, distortion_coefficients=D, **SIZES),
    "opencv12.yml": opencv(K=K, D=D, **SIZES).replace("%YAML:1.0", "%YAML 1.2"),
    "ints.yml": opencv(K=K, D=D, **SIZES).replace("0.,", "0,").replace("1. ]", "1 ]"),
    "sample.yml": opencv(
        calibration_time=3,
        image_width=1624,
        image_height=1240,
        board_width=9,
        board_height=6,
        square_size=25.0,
        camera_matrix=K,
        distortion_coefficients=D[:, None],
        avg_reprojection_error=0.2,
        per_view_reprojection_errors=np.ones((4, 1)),
    ),
    "nested.yaml": dumped(camera_matrix=K, dist_coeff=D[None], **SIZES),
    "flat.yaml": dumped(mtx=K.ravel(), dist=D, **SIZES),
    "no_commas.yaml": f"K: [{rows_of(K.ravel())}]\nD: [{rows_of(D)}]\nimage_size: [1624, 1240]\n",
    "printed.yaml": f'mtx: "{np.array2string(K)}"\ndist: "{np.array2string(D)}"\n'
    "shape: [1240, 1624]\n",
    "alone.txt": rows_of(K) + "\n" + rows_of(D) + "\n",
    "alone.csv": rows_of(K, ",") + "\n" + rows_of(D, ",") + "\n",
    "tuple.yaml": yaml.dump({"K": K.tolist(), "D": D.tolist(), "image_size": SIZE}),
    "documents.yaml": "---\n" + dumped(K=K, D=D, width=1624, height=1240) + "---\nother: 1\n",
    "nested.json": in_json(camera_matrix=K, dist_coeff=D[None], **SIZES),
    "rows.json": in_json(
        K={"rows": 3, "cols": 3, "data": K.ravel()},
        D={"rows": 1, "cols": 5, "data": D},
        resolution=[1624, 1240],
    ),
    "inner.json": in_json(
        calibration={
            "cam0": {"intrinsics": {"matrix": K}, "distortion": D, "width": 1624, "height": 1240}
        }
    ),
    "realsense.json": in_json(**REALSENSE),
    "realsense_streams.json": in_json(color=REALSENSE),
    "mecheye.json": in_json(
        CameraMatrix=named(),
        CameraDistCoeffs=dict(zip(("k1", "k2", "p1", "p2", "k3"), D.tolist(), strict=True)),
        **SIZES,
    ),
    "zivid.yml": yaml.safe_dump({**ZIVID, **SIZES}),
    "ensenso.json": in_json(**ENSENSO, **SIZES),
    "kalibr.yaml": dumped(
        cam0={
            "camera_model": "pinhole",
            "intrinsics": [2210.5, 2212.0, 811.25, 622.5],
            "distortion_model": "radtan",
            "distortion_coeffs": D,
            "resolution": [1624, 1240],
            "rostopic": "/left",
        }
    ),
    "rc_param.txt": RC_PARAM,
    "values.txt": "\n".join(
        f"{k} = {v}"
        for k, v in {
            **named(),
            "k1": -0.0812,
            "k2": 0.1334,
            "p1": 0.0004,
            "p2": -0.0011,
            "k3": 0.025,
            "width": 1624,
            "height": 1240,
        }.items()
    ),
    "headings.txt": f"Camera matrix:\n{np.array2string(K)}\nDistortion coefficients:\n"
    f"{np.array2string(D)}\nwidth: 1624\nheight: 1240\n",
    "printed.txt": f"ret = 0.21\nmtx = {K!r}\ndist = {D[None]!r}\nwidth = 1624\nheight = 1240\n",
    "python.txt": f"K = np.array({K.tolist()})\nD = np.array({D.tolist()})\n",
    "sections.txt": "[camera]\n"
    + "\n".join(f"{k}={v}" for k, v in named().items())
    + "\n[distortion]\nk1=-0.0812\nk2=0.1334\np1=0.0004\np2=-0.0011\nk3=0.025\n",
    "tables.toml": f"[camera]\nmatrix = {K.tolist()}\ndistortion = {D.tolist()}\n"
    "size = [1624, 1240]\n",
    "german.txt": "Kamera\nK\n2210,5;0;811,25\n0;2212,0;622,5\n0;0;1\nD\n-0,0812;0,1334;0,0004;"
    "-0,0011;0,025\nwidth = 1624\nheight = 1240\n",
    "savez.npz": archive(
        mtx=K,
        dist=D[None],
        rvecs=np.ones((1, 3, 1)),
        tvecs=np.ones((1, 3, 1)),
        image_size=np.array(SIZE),
    ),
    "new_matrix.npz": archive(
        mtx=K, newcameramtx=K * [[0.9], [0.9], [1]], dist=D, img_shape=np.array([1240, 1624])
    ),
    "camera.mat": matlab_file(params=matlab(K, D)),
    "camera_new.json": in_json(**matlab(K, D, new=True)),
    "bouguet.mat": matlab_file(
        fc=np.array([[2210.5], [2212.0]]),
        cc=np.array([[811.25], [622.5]]),
        kc=D[:, None],
        alpha_c=0.0,
        nx=1624.0,
        ny=1240.0,
    ),
    "utf16.yaml": dumped(K=K, D=D, **SIZES).encode("utf-16"),
}


def test_numbers_survive_any_form(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forms")
    number = st.floats(0.3, 3.0, allow_nan=False)

    @settings(deadline=None, max_examples=30)
    @given(st.lists(number, min_size=4, max_size=4), st.lists(st.floats(-1, 1), min_size=5,
                                                              max_size=5))  # fmt: skip
    def law(factors, coefficients):
        matrix = K * [[factors[0], 1, 1], [1, factors[1], 1], [1, 1, 1]]
        matrix = np.array([[matrix[0, 0], 0, 811 * factors[2]], [0, matrix[0, 0] * 1.01, 622.0],
                           [0, 0, 1]])  # fmt: skip
        nodes = {"K": matrix, "dist": np.array(coefficients)}
        for name, form in (("c.yml", opencv), ("c.yaml", dumped), ("c.json", in_json),
                           ("c.npz", archive)):  # fmt: skip
            camera = read_calibration(write(folder / name, form(**nodes)), image_size=SIZE).camera
            np.testing.assert_array_equal(camera.matrix, matrix)
            np.testing.assert_array_equal(camera.distortion, coefficients)

    law()


def write(path, content):
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content, encoding="utf-8")
    return path


def assert_camera(camera, k=K, d=D, size=SIZE):
    np.testing.assert_allclose(camera.matrix, k, rtol=1e-9)
    np.testing.assert_allclose(camera.coefficients[: len(d)], d, rtol=1e-9)
    assert not camera.coefficients[len(d) :].any()
    assert (camera.width, camera.height) == size


@pytest.mark.parametrize("name", ONE_CAMERA)
def test_one_camera(tmp_path, name):
    found = read_calibration(write(tmp_path / name, ONE_CAMERA[name]), image_size=SIZE)
    assert_camera(found.camera)
    assert found.second is None
    assert found.projector is None


SCREEN = {"screenResX": 1280, "screenResY": 800}
RIGS = {
    "slstudio.yml": opencv(Kc=K, kc=D, Kp=KP, kp=DP, Rp=R, Tp=T[:, None], frameWidth=1624,
                           frameHeight=1240, **SCREEN),
    "scan3d.yml": opencv(cam_K=K, cam_kc=D, proj_K=KP, proj_kc=DP, R=R, T=T[:, None],
                         cam_error=0.21, proj_error=0.34, stereo_error=0.3),
    "procam.yml": opencv(img_shape=[1240, 1624], cam_int=K, cam_dist=D, proj_int=KP, proj_dist=DP,
                         roration=R, translation=T[:, None]),
    "devices.json": in_json(camera={"K": K, "D": D, "width": 1624, "height": 1240},
                            projector={"K": KP, "D": DP, "width": 1280, "height": 800},
                            extrinsics={"R": R, "T": T}),
    "extrinsics_each.json": in_json(
        camera={"K": K, "dist": D, "R": np.eye(3), "t": np.zeros(3)},
        projector={"K": KP, "dist": DP, "R": R, "t": T}),
    "glued.yaml": dumped(camK=K, camD=D, projK=KP, projD=DP, R=R, T=T),
    "camel.json": in_json(cameraMatrix=K, cameraDistortion=D, projectorMatrix=KP,
                          projectorDistortion=DP, rotation=R, translation=T),
    "half_named.npz": archive(camera_matrix=K, dist=D, projector_matrix=KP, projector_dist=DP,
                              R=R, T=T),
    "suffixed.yaml": dumped(K_cam=K, D_cam=D, K_proj=KP, D_proj=DP, transform=MOTION),
    "motion.json": in_json(K_cam=K, dist_cam=D, K_prj=KP, dist_prj=DP,
                           projector_from_camera=MOTION),
    "to.json": in_json(K_cam=K, dist_cam=D, K_proj=KP, dist_proj=DP, cam_to_proj=MOTION[:3]),
    "inverse.json": in_json(K_cam=K, dist_cam=D, K_proj=KP, dist_proj=DP,
                            camera_from_projector=BACK),
    "inverse_to.npz": archive(cam_mtx=K, cam_dist=D, proj_mtx=KP, proj_dist=DP,
                              R_proj2cam=BACK[:3, :3], T_proj2cam=BACK[:3, 3]),
    "vector.npz": archive(cam_mtx=K, cam_dist=D, proj_mtx=KP, proj_dist=DP,
                          rvec=np.array([0, np.radians(14), 0]), tvec=T),
    "essential.yml": opencv(cam_K=K, cam_kc=D, proj_K=KP, proj_kc=DP, R=R, T=T[:, None],
                            E=np.ones((3, 3)), F=np.eye(3) * 2, R1=R.T, R2=R),
    "numbered.yml": opencv(M1=K, D1=D, M2=KP, D2=DP, R=R, T=T[:, None]),
    "inside.json": in_json(setup={
        "camera": {"K": K, "D": D, "width": 1624, "height": 1240},
        "projector": {"K": KP, "D": DP, "width": 1280, "height": 800},
        "R": R, "T": T}),
    "in_metres.json": in_json(K_cam=K, D_cam=D, K_proj=KP, D_proj=DP, R=R, translation_m=T / 1000),
    "unit.yaml": dumped(K_cam=K, D_cam=D, K_proj=KP, D_proj=DP, R=R, T=T / 10, unit="cm"),
}  # fmt: skip


@pytest.mark.parametrize("name", RIGS)
def test_camera_and_projector(tmp_path, name):
    found = read_calibration(
        write(tmp_path / name, RIGS[name]),
        image_size=SIZE,
        projector_size=PROJECTOR_SIZE,
        second="projector",
    )
    assert_camera(found.camera)
    assert_camera(found.projector, KP, DP, PROJECTOR_SIZE)
    np.testing.assert_allclose(found.transform.to_matrix(), MOTION, atol=1e-9)


K2 = KP * [[1.1], [1.1], [1.0]]
PAIRS = {
    "stereo.yml": opencv(M1=K, D1=D, M2=K2, D2=DP, R=R, T=T[:, None]),
    "spelled.yml": opencv(cameraMatrix1=K, distCoeffs1=D, cameraMatrix2=K2, distCoeffs2=DP, R=R,
                          T=T[:, None], E=np.ones((3, 3)), F=np.ones((3, 3))),
    "left_right.json": in_json(K_left=K, dist_left=D, K_right=K2, dist_right=DP, R=R, T=T),
    "letters.npz": archive(mtxL=K, distL=D, mtxR=K2, distR=DP, R=R, T=T),
    "maps.json": in_json(left={"K": K, "D": D}, right={"K": K2, "D": DP}, R=R, T=T),
    "right_first.json": in_json(right={"K": K2, "D": DP}, left={"K": K, "D": D}, R=R, T=T),
    "matlab.json": in_json(CameraParameters1=matlab(K, D), CameraParameters2=matlab(K2, DP),
                           RotationOfCamera2=R.T, TranslationOfCamera2=T, WorldUnits="mm"),
    "matlab_new.mat": matlab_file(s={"CameraParameters1": matlab(K, D, new=True),
                                     "CameraParameters2": matlab(K2, DP, new=True),
                                     "PoseCamera2": {"R": R, "Translation": T}}),
    "kalibr.yaml": dumped(
        cam0={"camera_model": "pinhole", "intrinsics": [2210.5, 2212.0, 811.25, 622.5],
              "distortion_coeffs": D, "resolution": list(SIZE)},
        cam1={"camera_model": "pinhole", "intrinsics": [K2[0, 0], K2[1, 1], K2[0, 2], K2[1, 2]],
              "distortion_coeffs": DP, "resolution": list(SIZE),
              "T_cn_cnm1":
              np.vstack([np.hstack([R, T[:, None] / 1000]), [0, 0, 0, 1]])}),
    "realsense.json": in_json(
        left=REALSENSE, right={**REALSENSE, "fx": K2[0, 0], "fy": K2[1, 1], "ppx": K2[0, 2],
                                               "ppy": K2[1, 2], "coeffs": DP},
        extrinsics={"rotation": R.T.ravel(), "translation": T / 1000}),
    "inside.yaml": dumped(stereo={"left": {"K": K, "D": D, **SIZES},
                                  "right": {"K": K2, "D": DP, **SIZES}, "R": R, "T": T}),
    "bouguet.mat": matlab_file(KK_left=K, kc_left=D[:, None], KK_right=K2, kc_right=DP[:, None],
                               R=R, T=T[:, None], om=np.array([[0], [0.24], [0]])),
}  # fmt: skip


@pytest.mark.parametrize("name", PAIRS)
def test_two_cameras(tmp_path, name):
    found = read_calibration(write(tmp_path / name, PAIRS[name]), image_size=SIZE)
    assert_camera(found.camera)
    assert_camera(found.second, K2, DP)
    np.testing.assert_allclose(found.transform.to_matrix(), MOTION, atol=1e-9)


# -- ROS ----------------------------------------------------------------------------------------

P = np.array([[2100.0, 0, 800, 0], [0, 2100, 620, 0], [0, 0, 1, 0]])


def message(**more):
    return dumped(height=1240, width=1624, distortion_model="plumb_bob", d=D, k=K.ravel(),
                  r=np.eye(3).ravel(), p=P.ravel(), **more) + "---\n"  # fmt: skip


def test_ost_of_one_camera(tmp_path):
    path = write(tmp_path / "ost.ini", OST.format(name="left", offset=0.0))
    assert_camera(read_calibration(path, images="raw").camera)
    assert_camera(read_calibration(path, images="rectified").camera, P[:, :3], ())


def test_ost_of_two_cameras(tmp_path):
    text = OST.format(name="stereo/left", offset=0.0) + OST.format(
        name="stereo/right", offset=-210.0
    )
    found = read_calibration(write(tmp_path / "ost.txt", text), images="rectified")
    np.testing.assert_allclose(found.transform.translation_mm, (-100.0, 0, 0))


def test_binned_frames_have_half_the_pixels(tmp_path):
    path = write(tmp_path / "c.yaml", message(binning_x=2, binning_y=2))
    with collected_remarks() as remarks:
        camera = read_calibration(path, images="raw").camera
    # Of four pixels the middle lies at 2u + 0.5.
    half = [[2210.5 / 2, 0, (811.25 - 0.5) / 2], [0, 1106.0, (622.5 - 0.5) / 2], [0, 0, 1]]
    assert_camera(camera, half, D, (812, 620))
    assert any("2 × 2 binned" in remark for remark in remarks)
    ray = ((100 + 0.5) * 2 - 0.5 - 811.25) / 2210.5  # of frame's column 100
    assert (100 - camera.cx) / camera.fx == pytest.approx(ray)


def test_a_region_moves_the_principal_point(tmp_path):
    roi = {"x_offset": 200, "y_offset": 100, "width": 1000, "height": 800, "do_rectify": False}
    path = write(tmp_path / "c.yaml", message(roi=roi, binning_x=2, binning_y=0))
    found = read_calibration(path, images="rectified").camera
    expected = [[1050.0, 0, (800 - 200 - 0.5) / 2], [0, 2100, 520], [0, 0, 1]]
    assert_camera(found, expected, (), (500, 800))


@pytest.mark.parametrize(
    ("roi", "message_"),
    [
        ({"x_offset": 900, "y_offset": 0, "width": 1000, "height": 800}, "not within 1624"),
        ({"x_offset": 9, "y_offset": 0, "width": 900, "height": 800, "do_rectify": True}, "--raw"),
    ],
)
def test_regions_that_cannot_be(tmp_path, roi, message_):
    path = write(tmp_path / "c.yaml", message(roi=roi))
    with pytest.raises(FormatError, match=message_):
        read_calibration(path, images="rectified")


def test_a_projection_alone_is_of_rectified_images(tmp_path):
    path = write(tmp_path / "c.json", in_json(P=P, width=1624, height=1240, baseline=0.1))
    found = read_calibration(path)
    assert_camera(found.camera, P[:, :3], ())
    assert found.images == "rectified"


def test_raw_or_rectified_is_asked_for_in_any_form(tmp_path):
    one = write(tmp_path / "one.json", in_json(K=K, D=D, P_rect=P, **SIZES))
    two = write(tmp_path / "two.json", in_json(
        K_left=K, D_left=D, K_right=K2, D_right=DP, R=R, T=T, P_left=P,
        P_right=P - [[0, 0, 0, 2100 * np.linalg.norm(T)], [0] * 4, [0] * 4]))  # fmt: skip
    for path, size in ((one, None), (two, SIZE)):
        with pytest.raises(FormatError, match="--raw or --rectified"):
            read_calibration(path, image_size=size)
        assert_camera(read_calibration(path, image_size=size, images="raw").camera)
        found = read_calibration(path, image_size=size, images="rectified")
        assert_camera(found.camera, P[:, :3], ())


def test_one_of_two_devices_without_a_pose(tmp_path):
    path = write(tmp_path / "c.json", in_json(rgb={"K": K, "D": D}, depth={"K": KP, "D": DP}))
    with pytest.raises(AmbiguousError) as asked:
        read_calibration(path, image_size=SIZE)
    assert "--keys camera_matrix=rgb.K" in asked.value.readings
    keys = CalibrationKeys(camera_matrix="rgb.K")
    assert_camera(read_calibration(path, keys=keys, image_size=SIZE).camera)


def test_keys_do_not_go_with_a_camera_info(tmp_path):
    with pytest.raises(FormatError, match="leave out the keys"):
        read_calibration(write(tmp_path / "c.yaml", message()), keys=CalibrationKeys(rotation="r"))


def test_a_second_file_that_adds_nothing(tmp_path):
    one = write(tmp_path / "a.json", in_json(K=K, D=D, **SIZES))
    with pytest.raises(FormatError, match="one camera in both"):
        read_calibration(one, write(tmp_path / "b.json", in_json(R=R, T=T)))


def test_eight_coefficients_announced_as_five(tmp_path):
    eight = np.array([0.41, -1.2, 0.0003, -0.0002, 0.65, 0.29, -1.1, 0.6])
    text = dumped(image_width=1624, image_height=1240, distortion_model="rational_polynomial",
                  camera_matrix={"rows": 3, "cols": 3, "data": K.ravel()},
                  distortion_coefficients={"rows": 1, "cols": 5, "data": eight})  # fmt: skip
    assert_camera(read_calibration(write(tmp_path / "c.yaml", text)).camera, K, eight)


# -- what is asked, and its answers -------------------------------------------------------------


def test_keys_name_what_names_do_not_tell(tmp_path):
    path = write(tmp_path / "c.npz", archive(A1=K, V1=D, A2=KP, V2=DP, X=R, Y=T, Z=T + 1,
                                             s=np.array(SIZE)))  # fmt: skip
    with pytest.raises(AmbiguousError, match=r"A1 and A2 do not tell") as asked:
        read_calibration(path)
    assert "--keys camera_matrix=A1,projector_matrix=A2" in asked.value.readings
    keys = CalibrationKeys.parse(
        "camera_matrix=A2, projector_matrix=A1,camera_distortion=V2,projector_distortion=V1,"
        "rotation=X,translation=Y,direction=projector_from_camera"
    )
    found = read_calibration(path, keys=keys, image_size=(1280, 1500), projector_size=SIZE)
    assert_camera(found.camera, KP, DP, (1280, 1500))
    assert_camera(found.projector, K, D)


def test_wrong_keys_are_told_with_what_the_file_has(tmp_path):
    path = write(tmp_path / "c.npz", archive(A1=K, V1=D))
    with pytest.raises(FormatError, match=r"no node 'A'.*A1 \(3×3\), V1 \(5\)"):
        read_calibration(path, keys=CalibrationKeys(camera_matrix="A"))


@pytest.mark.parametrize(
    ("text", "message_"),
    [
        ("camera=K", "ENTRY=NODE.*did you mean 'camera_"),
        ("K", "ENTRY=NODE"),
        ("rotation=R,rotation=S", "rotation twice"),
        ("direction=left", "direction must be"),
        ("projector_matrix=K,second_matrix=L", "one of both"),
    ],
)
def test_keys_that_are_none(text, message_):
    with pytest.raises(InputError, match=message_):
        CalibrationKeys.parse(text)


def test_names_of_nodes_may_hold_blanks_and_commas():
    keys = CalibrationKeys.parse("camera_matrix=Camera  0.a, b,rotation=R")
    assert (keys.camera_matrix, keys.rotation) == ("Camera  0.a, b", "R")


AMBIGUOUS = {
    "three.npz": archive(Ka=K, Kb=K2, Kc=KP),
    "two_distortions.npz": archive(K=K, dist_a=D, dist_b=DP),
    "unnamed.npz": archive(K=K, numbers=D),
    "same.json": in_json(cam_K=K, proj_K=KP, dist1=D, dist2=DP, R=R, T=T),
    "poses.npz": archive(cam_K=K, proj_K=KP, Ra=R, Rb=R.T, t=T),
    "ways.npz": archive(cam_K=K, proj_K=KP, R=R, Ta=T, Tb=T + 1),
    "order.json": in_json(K_cam=K, K_proj=KP, T_cam_proj=MOTION),
    "pose.json": in_json(K_cam=K, K_proj=KP, projector_pose=MOTION),
    "letters.yaml": dumped(A=K, B=KP, R=R, T=T),
}


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_what_fits_twice_is_asked_for(tmp_path, name):
    with pytest.raises(AmbiguousError, match="--keys") as asked:
        read_calibration(write(tmp_path / name, AMBIGUOUS[name]), image_size=SIZE,
                         projector_size=PROJECTOR_SIZE)  # fmt: skip
    for answer in asked.value.readings:  # each can be given as it stands
        CalibrationKeys.parse(answer.removeprefix("--keys "))


def test_an_inverted_pose_is_noticed(tmp_path):
    # A camera 200 mm behind the projector, to its side: the other way round nothing is seen.
    place = RigidTransform(rotation=R.T, translation_mm=(20.0, 0.0, -200.0))
    right = place  # projector_from_camera
    text = in_json(cam_K=K, proj_K=KP, R=right.inverse().rotation,
                   T=right.inverse().translation_mm)  # fmt: skip
    path = write(tmp_path / "c.json", text)
    sizes = {"image_size": SIZE, "projector_size": PROJECTOR_SIZE}
    with pytest.raises(ContradictionError, match="--keys direction=camera_from_projector"):
        read_calibration(path, **sizes)
    keys = CalibrationKeys(direction="camera_from_projector")
    found = read_calibration(path, keys=keys, **sizes)
    np.testing.assert_allclose(found.transform.to_matrix(), right.to_matrix(), atol=1e-9)


def test_a_translation_of_the_wrong_sign_is_remarked_on(tmp_path):
    path = write(tmp_path / "c.json", in_json(cam_K=K, proj_K=KP, R=R, T=-T))
    with collected_remarks() as remarks:
        read_calibration(path, image_size=SIZE, projector_size=PROJECTOR_SIZE)
    assert any("has the translation the wrong sign" in remark for remark in remarks)


def test_a_translation_in_metres(tmp_path):
    path = write(tmp_path / "c.json", in_json(cam_K=K, proj_K=KP, R=R, T=T / 1000))
    sizes = {"image_size": SIZE, "projector_size": PROJECTOR_SIZE}
    with pytest.raises(ContradictionError, match="--read-as unit=m"):
        read_calibration(path, **sizes)
    with reading_as(Reading(unit="m")):
        found = read_calibration(path, **sizes)
    np.testing.assert_allclose(found.transform.translation_mm, T)


def test_all_that_is_missing_is_told_at_once(tmp_path):
    path = write(tmp_path / "c.npz", archive(cam_K=K, cam_d=D, proj_K=KP, proj_d=DP, R=R))
    with pytest.raises(FormatError, match=r"images' size.*projector's size.*no translation"):
        read_calibration(path)


def test_what_was_recognised_is_said_in_a_line(tmp_path):
    path = write(tmp_path / "c.yml", RIGS["scan3d.yml"])
    with collected_remarks() as remarks:
        read_calibration(path, image_size=SIZE, projector_size=PROJECTOR_SIZE)
    (line,) = remarks
    assert line == (
        f"{path}: camera from cam_K, cam_kc; projector from proj_K, proj_kc; "
        "R, T take the camera's frame to the projector's"
    )
    with collected_remarks() as remarks:  # exposight's own form
        read_calibration(write(tmp_path / "own.yml", RIGS["slstudio.yml"]))
    assert not remarks


def test_matlab_is_said(tmp_path):
    with collected_remarks() as remarks:
        read_calibration(write(tmp_path / "c.json", PAIRS["matlab.json"]))
    assert any("row vectors" in remark and "counts from 1" in remark for remark in remarks)


# -- what is refused ----------------------------------------------------------------------------

REFUSED = {
    "fisheye.yaml": (dumped(K=K, D=D[:4], distortion_model="fisheye", **SIZES), "undistort"),
    "kalibr_equi.yaml": (dumped(cam0={"intrinsics": [500.0, 500, 300, 200], "distortion_model":
                                      "equidistant", "distortion_coeffs": D[:4]}), "undistort"),
    "matlab_fisheye.json": (in_json(MappingCoefficients=D[:4], ImageSize=[1240, 1624]), "undist"),
    "inverse.json": (in_json(**{**REALSENSE, "model": "distortion.inverse_brown_conrady"}),
                     "none of OpenCV's"),
    "sample_fisheye.yml": (opencv(camera_matrix=K, fisheye_model=1, **SIZES), "undistort"),
    "announced.yml": (opencv(K=K, D=D).replace("-0.0811", "1, -0.0811").replace("cols: 5",
                      "cols: 8"), "announces 1 × 8 numbers and has"),
    "transposed.json": (in_json(K=K.T, D=D, **SIZES), "transposed"),
    "normalised.json": (in_json(fx=1.3, fy=1.4, cx=0.5, cy=0.5, **SIZES), "no camera matrix"),
    "other_size.json": (in_json(K=K, D=D, image_size=[812, 620]), "812 × 620.*1624 × 1240"),
    "short.json": (in_json(K=K, dist=D[:3], **SIZES), "coefficients in OpenCV's order, got 3"),
    "nan.json": (in_json(K=K, dist=D * np.nan, **SIZES), "finite"),
    "objects.npz": (archive(K=np.array([{"a": 1}], dtype=object)), "Python objects"),
    "python.yaml": (yaml.dump({"K": K}), "tolist"),
    "large.txt": (b"1 " * 2_600_000, "MB"),
    "v73.mat": (b"MATLAB 7.3 MAT-file" + b" " * 200, "v7"),
    "cut.mat": (matlab_file(K=K)[:150], "not a calibration"),
    "cut.npz": (archive(K=K)[:200], "not a calibration"),
    "bomb.npz": (None, "24000128 bytes"),
    "numbers.txt": ("1 2 3\n4 5 6\n", "no camera matrix"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_what_to_do(tmp_path, name):
    content, message_ = REFUSED[name]
    if name == "bomb.npz":
        file = io.BytesIO()
        np.savez_compressed(file, K=np.zeros(3_000_000))
        content = file.getvalue()
    with pytest.raises(FormatError, match=message_):
        read_calibration(write(tmp_path / name, content), image_size=SIZE)


def test_a_size_the_other_way_round_is_asked_for(tmp_path):
    path = write(tmp_path / "c.json", in_json(K=K, D=D, image_size=[1240, 1624]))
    with pytest.raises(FormatError, match="--image-size 1624 1240"):
        read_calibration(path)
    assert_camera(read_calibration(path, image_size=SIZE).camera)


def test_two_files_of_which_one_contradicts_the_other(tmp_path):
    one = write(tmp_path / "intrinsics.yml", opencv(M1=K, D1=D, M2=K2, D2=DP))
    other = write(tmp_path / "extrinsics.yml", opencv(R=R, T=T[:, None], M1=K2))
    with pytest.raises(FormatError, match="both have a node 'M1'"):
        read_calibration(one, other, image_size=SIZE)


def test_yaml_in_one_line_and_a_file_that_was_cut_off(tmp_path):
    path = tmp_path / "flow.yaml"
    nodes = lists({"K": K.ravel(), "D": D, "width": SIZE[0], "height": SIZE[1]})
    path.write_text(yaml.safe_dump(nodes, default_flow_style=True))
    assert read_calibration(path).camera.fx == K[0, 0]
    whole = opencv(camera_matrix=K, distortion_coefficients=D)[10:]  # without its first line
    path.write_text(whole[: whole.index("distortion_coefficients") + 5])
    with pytest.raises(FormatError, match=r"cannot|could not"):
        read_calibration(path, image_size=SIZE)


@pytest.mark.parametrize(
    "text",
    [
        in_json(K=K, radial=D[[0, 1, 4]], tangential=D[2:4]),
        in_json(K=K, dist={"radial": D[[0, 1, 4]], "tangential": D[2:4]}),
        dumped(K=K, RadialCoefficients=D[[0, 1, 4]], TangentialCoefficients=D[2:4]),
        in_json(K=K, **{f"radial_k{n}": D[p] for n, p in ((1, 0), (2, 1), (3, 4))},
                tangential_p1=D[2], tangential_p2=D[3]),
        in_json(K=K, lens={"radial": {"k1": D[0], "k2": D[1], "k3": D[4]},
                           "tangential": {"p1": D[2], "p2": D[3]}}),
    ],
)  # fmt: skip
def test_radial_and_tangential_coefficients_are_of_one_lens(tmp_path, text):
    path = tmp_path / "calibration.txt"
    path.write_text(text)
    camera = read_calibration(path, image_size=SIZE).camera
    np.testing.assert_allclose(camera.distortion, D)


def test_open3d_writes_its_matrix_column_by_column(tmp_path):
    path = tmp_path / "intrinsic.json"
    path.write_text(in_json(width=SIZE[0], height=SIZE[1], intrinsic_matrix=K.T.ravel()))
    with collected_remarks() as remarks:
        camera = read_calibration(path).camera
    assert (camera.fx, camera.cx, camera.cy) == (K[0, 0], K[0, 2], K[1, 2])
    assert "column by column" in "".join(remarks)
    path.write_text(in_json(matrix=K.T))  # may be MATLAB's, which counts pixels from 1
    with pytest.raises(FormatError, match="transposed"):
        read_calibration(path, image_size=SIZE)


def test_bouguets_results_tell_the_images_size(tmp_path):
    path = tmp_path / "Calib_Results.m"
    path.write_text(
        f"fc = [ {K[0, 0]} ; {K[1, 1]} ];\ncc = [ {K[0, 2]} ; {K[1, 2]} ];\nalpha_c = 0;\n"
        f"kc = [ {' ; '.join(map(str, D))} ];\nfc_error = [ 1 ; 1 ];\nnx = {SIZE[0]};\n"
        f"ny = {SIZE[1]};\n"
    )
    camera = read_calibration(path).camera
    assert (camera.width, camera.height) == SIZE
    np.testing.assert_allclose(camera.distortion, D)
