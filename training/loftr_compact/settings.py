"""Settings of a training run. The weights that salframe ships were trained with the defaults."""

from __future__ import annotations

from pydantic import Field

from salframe.framework.validation import Settings


class Panoramas(Settings):
    """Rendering of the panoramas that pairs are cut from."""

    rooms: int = Field(10, ge=4, description="number of rooms per building")
    changed_fraction: float = Field(0.15, ge=0, le=1, description="share of objects that change before the evening")
    height: int = Field(512, ge=64, multiple_of=4)


class Stage(Settings):
    """A stage of the training: steps with views of one size."""

    width_px: int = Field(ge=16, multiple_of=8)
    height_px: int = Field(ge=16, multiple_of=8)
    batch: int = Field(ge=1, description="number of pairs per step")
    steps: int = Field(ge=1)
    buildings: int = Field(ge=1, description="number of training buildings that pairs come from")


class LoftrTrainingSettings(Settings):
    """All settings of a run."""

    seed: int = Field(0, ge=0)
    panoramas: Panoramas = Panoramas()
    held_out_seed: int = Field(
        5000, ge=0, description="seed of the held-out building; the training buildings have the following seeds"
    )
    stages: tuple[Stage, ...] = (
        Stage(width_px=160, height_px=120, batch=8, steps=800, buildings=5),
        Stage(width_px=160, height_px=120, batch=8, steps=4000, buildings=8),
        Stage(width_px=320, height_px=240, batch=4, steps=500, buildings=8),
    )
    peak_learning_rate: float = Field(1e-3, gt=0)
    warmup_steps: int = Field(100, ge=1)
    decay_steps: int = Field(1100, ge=1, description="number of last steps over which the learning rate decreases")
    weight_decay: float = Field(0.01, ge=0)
    fine_matches: int = Field(24, ge=1, description="maximum number of true matches per pair for the fine stage")
    report_every: int = Field(200, ge=1, description="steps between checkpoints and held-out measurements")
    processes: int = Field(
        2, ge=1, description="number of processes that share every batch; each has another process that cuts its pairs"
    )
