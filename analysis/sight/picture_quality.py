"""What all pictures of an experiment on sight suffer from."""

from dataclasses import dataclass

from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.cameras.scene import SceneStyle


@dataclass(frozen=True, kw_only=True)
class PictureQuality:
    """Noise and blur of the software camera's pictures."""

    noise: float = FrameGrabberParams.noise  # grey levels, standard deviation
    blur: float = SceneStyle.blur  # pixels, standard deviation

    def __post_init__(self) -> None:
        require_not_negative(self, "blur")
        if not 0 <= self.noise <= 60:
            raise ParameterError("noise", self.noise, "from 0 to 60")
