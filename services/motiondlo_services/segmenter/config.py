"""``[segmenter]``: backend and parameters of the frame branch."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from motiondlo.frames.params import FrameParams


class SegmenterConfig(FrameParams):
    """The segmenter's section: all of it are the frame branch's own parameters."""

    def resolved(self, folder: Path) -> Self:
        """Relative paths start at ``folder``, the configuration file's; a sam3 model that is no folder stays a name."""

        def path(name: str) -> str:
            return str((folder / Path(name).expanduser()).resolve()) if name else ""

        onnx = {"model": path(self.onnx.model), "further_inputs": path(self.onnx.further_inputs)}
        model = self.sam3.model
        if Path(path(model)).is_dir() or model.startswith((".", "~")):
            model = path(model)
        return self.model_copy(
            update={
                "replay_folder": path(self.replay_folder),
                "sam3": self.sam3.model_copy(update={"model": model}),
                "onnx": self.onnx.model_copy(update=onnx),
            }
        )
