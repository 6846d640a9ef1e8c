"""What settings and the command line offer: alternatives by name, and limits. Imports nothing heavy."""

from typing import Literal

Quality = Literal["coarse", "fine"]
"""Training presets: ``coarse`` has SH degree 0 and is quick, ``fine`` has degree 3."""

Backend = Literal["auto", "cpu", "gsplat", "triton", "reference"]
"""Rasterisers; ``auto`` is ``gsplat`` where it can run, else ``cpu``."""

CameraModel = Literal["SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"]
"""Camera models that structure from motion estimates."""

Poses = Literal["sfm", "known"]
"""Sources of the poses of visited views: estimated from their images alone, or the dataset's."""

InitialChoice = Literal["first", "consecutive", "farthest", "planned"]
"""The initial views of a selection, see ``fvs_engine.select.initial_views``."""

HoldOut = Literal["every", "random"]
"""Which views are held out, see ``fvs_engine.hold_out``."""

RankingMethod = Literal["median-frequency", "median-frequency-fast", "median-frequency-estimate"]
"""Scorers of ``fvs rank``, see ``fvs_engine.score``; all of them are selectors, too."""

ProtocolName = Literal["paper", "fisherrf", "nearest5", "travel"]
"""Protocols of a comparison, see ``fvs_engine.lab.evaluate.protocol``."""

ViewGroup = Literal["held-out", "training", "all", "path"]
"""Views of a model that can be rendered together; ``path`` is a smooth path through the training views."""

ExportFormat = Literal["ply", "spz", "gltf", "3d-tiles", "cameras", "colmap", "geojson", "laz"]
"""What a model can be exported as, see ``fvs_engine.export``."""

ExportFrame = Literal["world", "model"]
"""The frame of exported files: metres east, north and up of a place on Earth, or the model's own."""

Firmware = Literal["ardupilot", "px4"]
"""Autopilots whose MAVLink ``fvs simulate-vehicle`` speaks: ``lab.simulate.mavlink.firmware``."""

CameraReports = Literal["both", "feedback", "captured", "none"]
"""What tells of a vehicle's photographs: ``CAMERA_FEEDBACK``, ``CAMERA_IMAGE_CAPTURED``, both or none."""

LookAlike = Literal["four", "two", "windows"]
"""Walls of a simulated courtyard that look alike, see ``fvs_engine.lab.simulate.facades``."""

MAX_VEHICLES = 20
"""Maximum number of vehicles of a fleet."""
