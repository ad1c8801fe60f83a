"""Rigs of GenICam cameras as a driver: structured light of one camera, or a stereo head of two."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

from exposight.cell import ActiveSensor, Capture, Cloud, Image, Part, StackImages
from exposight.drivers.cell_file import Cell, read_cell
from exposight.drivers.genicam_camera import CameraSettings, GenicamCamera
from exposight.drivers.moves import Mover
from exposight.errors import SensorError
from exposight.geometry import RigidTransform
from exposight.imaging import (
    DecodedMap,
    FrameStack,
    decode,
    mean_image,
    recorded_sigma_z,
    rectify,
    sequence_to_toml,
    stack_images,
    stereo_by_codes,
    stereo_by_images,
    triangulate,
    window_images,
)


class GenicamDriver:
    """GigE Vision and USB3 Vision cameras of a cell's file (`exposight.cell.Driver`).

    With a projector and a sequence, each capture is a stack of patterns that is decoded; one camera
    is triangulated with the projector, two with each other. Without, two cameras are matched by
    what they show. The devices are opened at the first use and held until `close`.

    Parameters
    ----------
    cell : Cell
        Sensor, part, cameras and commands.
    open_camera : callable
        Opens a camera of its settings.

    Raises
    ------
    SensorError
        If the cell has no camera, or its cameras are not as many as the sensor's.
    """

    def __init__(
        self, cell: Cell, open_camera: Callable[[CameraSettings], GenicamCamera] = GenicamCamera
    ) -> None:
        self._cell = cell
        self._open_camera = open_camera
        self._cameras: tuple[GenicamCamera, ...] = ()
        self._mover = Mover(cell.file.move)
        self._settings = tuple(
            each for each in (cell.file.camera, cell.file.second_camera) if each is not None
        )
        sensor = cell.sensor
        if not self._settings or len(self._settings) != len(sensor.cameras):
            msg = (
                f"sensor {sensor.name!r} has {len(sensor.cameras)} cameras, the cell's file names "
                f"{len(self._settings)}: give [camera] and, of a stereo head, [second_camera]"
            )
            raise SensorError(msg)
        if len(self._settings) == 1 and (cell.sequence is None or sensor.projector is None):
            msg = (
                f"sensor {sensor.name!r} has one camera: it measures with a projector, so give "
                "[projector] and [sequence], and a sensor file with the projector's calibration"
            )
            raise SensorError(msg)
        self._pair = None
        if len(sensor.cameras) == 2:
            self._pair = rectify(*sensor.cameras, sensor.first_from_camera[1])

    @classmethod
    def of_file(cls, path: str | Path) -> GenicamDriver:
        """Return the driver of a cell's file.

        Raises
        ------
        FileError, SensorError
            As for `read_cell` and `GenicamDriver`.
        """
        return cls(read_cell(path))

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor of the cell's file."""
        return self._cell.sensor

    @property
    def part(self) -> Part | None:
        """The part of the cell's file, where it names one."""
        return self._cell.part

    @property
    def cameras(self) -> tuple[GenicamCamera, ...]:
        """The cameras, opened at the first use.

        Raises
        ------
        SensorError
            As for `GenicamCamera`.
        """
        if not self._cameras:
            opened: list[GenicamCamera] = []
            try:
                for settings in self._settings:
                    opened.append(self._open_camera(settings))
            except BaseException:
                for camera in opened:
                    camera.close()
                raise
            self._cameras = tuple(opened)
        return self._cameras

    def description(self) -> dict[str, object]:
        """Return what decides the captures, JSON-able."""
        cell = self._cell
        facts: dict[str, object] = {
            "driver": "genicam",
            "cameras": [camera.description() for camera in self.cameras],
        }
        if cell.sequence is not None:
            text = sequence_to_toml(cell.sequence).encode()
            facts["sequence_sha256"] = hashlib.sha256(text).hexdigest()
        return facts

    def close(self) -> None:
        """Restore the cameras' settings and let go of them; the driver may be used again."""
        cameras, self._cameras = self._cameras, ()
        for camera in cameras:
            camera.close()

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        """Move, set the exposure time, take all frames and compute the cloud.

        Parameters
        ----------
        exposure_ms : float, ms
            The capture has the one read back from the device.
        camera_from_part : RigidTransform
            The capture has the one that the ``[move]`` command printed, if it did.
        view : str

        Raises
        ------
        SensorError
            If a device or a command fails, or a setting was ignored.
        ContradictionError
            If frames contradict their sequence.
        """
        cameras = self.cameras
        reached = self._mover.move_to(camera_from_part, view)
        times = [camera.set_exposure(exposure_ms) for camera in cameras]
        if max(times) - min(times) > self.sensor.exposure.increment_ms:
            listed = " and ".join(f"{each:g}" for each in times)
            msg = f"the two cameras were set to {exposure_ms:g} ms and took {listed} ms"
            raise SensorError(msg)
        stacks = self._frames(times[0])
        facts = self._images(stacks) if self._cell.sequence is None else self._decoded(stacks)
        note = "; ".join(filter(None, (self._mover.remark, facts.pop("notes", ""))))
        return Capture(
            view=view, exposure_ms=times[0], camera_from_part=reached, notes=note, **facts
        )

    def _frames(self, exposure_ms: float) -> list[FrameStack]:
        """Take every pattern with every camera; without patterns, one frame."""
        projector, sequence = self._cell.file.projector, self._cell.sequence
        taken: list[list[Image]] = [[] for _ in self.cameras]
        depths = [8] * len(taken)
        for pattern in range(1 if sequence is None else sequence.n_frames):
            if projector is not None:
                projector.show(pattern)
            for i, camera in enumerate(self.cameras):
                frame = camera.frame()
                taken[i].append(frame.image)
                depths[i] = frame.bit_depth
        of_sequence: dict[str, Any] = {}
        if sequence is not None:
            of_sequence["saturation_level"] = sequence.saturation_level
            of_sequence["response"] = sequence.response()
        return [
            FrameStack(
                frames=cast("Image", np.stack(frames)),
                bit_depth=depth,  # type: ignore[arg-type]
                exposure_ms=exposure_ms,
                **of_sequence,
            )
            for frames, depth in zip(taken, depths, strict=True)
        ]

    def _images(self, stacks: list[FrameStack]) -> dict[str, Any]:
        """Match the images of two cameras."""
        if any(stack.bit_depth != 8 for stack in stacks):
            msg = 'images are matched in 8 bits: set pixel_format = "Mono8" of both cameras'
            raise SensorError(msg)
        assert self._pair is not None
        first, second = (stack.frames[0].astype(np.uint8) for stack in stacks)
        limits = self._cell.file.stereo
        depths = self.sensor.working_distance_mm
        match = stereo_by_images(first, second, self._pair, depth_limits_mm=depths, limits=limits)
        return {
            "image": first,
            "brightness_source": "dots",
            "stack": window_images(first, limits),
            "cloud": match.cloud,
        }

    def _decoded(self, stacks: list[FrameStack]) -> dict[str, Any]:
        """Decode stacks of patterns, and triangulate them."""
        sequence, choice = self._cell.sequence, self._cell.file.sequence
        assert sequence is not None
        assert choice is not None
        maps = [decode(stack, sequence, choice.limits) for stack in stacks]
        cloud, remark = self._points(stacks, maps)
        stack: StackImages = stack_images(
            stacks[0], sequence, maps[0], choice.limits, with_mean=False
        )
        return {
            "image": mean_image(stacks[0], sequence),
            "brightness_source": "stripes-mean",
            "stack": stack,
            "bit_depth": stacks[0].bit_depth,
            "cloud": cloud,
            "notes": remark,
        }

    def _points(self, stacks: list[FrameStack], maps: list[DecodedMap]) -> tuple[Cloud, str]:
        sensor, sequence = self.sensor, self._cell.sequence
        assert sequence is not None
        if self._pair is not None:
            depths = sensor.working_distance_mm
            return stereo_by_codes(maps[0], maps[1], self._pair, depth_limits_mm=depths).cloud, ""
        assert sensor.projector is not None
        poses: dict[str, Any] = {
            "projector": sensor.projector.camera,
            "projector_from_camera": sensor.projector.camera_from_projector.inverse(),
        }
        cloud = triangulate(maps[0], camera=sensor.camera, **poses)
        return recorded_sigma_z(cloud, stacks[0], sequence, maps[0], **poses)
