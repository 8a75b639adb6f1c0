"""Find and read scenes: a bundled one by its name, or a file."""

from __future__ import annotations

import sys
from pathlib import Path

from motiondlo.config.loader import read_toml
from motiondlo.config.validation import validated
from motiondlo.errors import ConfigError
from motiondlo.simulation.scene import SceneParams

# In config/ of a checkout, among the environment's shared files in an installation.
_FOLDERS = (
    Path(__file__).resolve().parents[3] / "config" / "scenes",
    Path(sys.prefix) / "share" / "motiondlo" / "scenes",
)


def bundled_scenes() -> dict[str, Path]:
    """Files of the bundled scenes by name."""
    folder = next((folder for folder in _FOLDERS if folder.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_scene(name_or_path: str) -> tuple[str, SceneParams]:
    """Name and content of a scene. Raises ConfigError when there is none, or a value in it is wrong."""
    bundled = bundled_scenes()
    path = bundled.get(name_or_path, Path(name_or_path))
    if not path.is_file():
        raise ConfigError(
            f"{name_or_path}: neither a bundled scene nor a file.", f"Bundled are: {', '.join(bundled) or 'none'}."
        )
    scene = validated(SceneParams, read_toml(path), str(path))
    for cable in scene.cables:
        if cable.gripper >= len(scene.grippers):
            raise ConfigError(f"{path}: a cable names gripper {cable.gripper}, which the scene lacks.", "Add it.")
    return path.stem, scene
