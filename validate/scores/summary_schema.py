"""summary.json as a strict schema, as far as other commands read it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from roundel.datasets.layout.schema import Count, Digest, RadianceRecord
from roundel.validate.metrics.metric import ELLIPSE_METRICS, HEADLINE

_OPEN = ConfigDict(strict=True, extra="allow", frozen=True)
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Share = Annotated[float, Field(ge=0, le=1)]


class StatisticsRecord(BaseModel):
    """Of the errors of a run; see `run_statistics.statistics`."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    n: Count
    mean: _Number | None
    median: _Number | None
    p95: _Number | None
    rms: _Number | None
    median_low: _Number | None = None
    median_high: _Number | None = None
    rms_low: _Number | None = None
    rms_high: _Number | None = None
    p95_low: _Number | None = None
    p95_high: _Number | None = None
    interval: dict[str, Any] = {}

    @model_validator(mode="after")
    def _whole(self) -> StatisticsRecord:
        if self.n and None in (self.mean, self.median, self.p95, self.rms):
            raise ValueError("has values, but not all of mean, median, p95 and rms")
        for name in ("median", "rms", "p95"):
            if (getattr(self, f"{name}_low") is None) != (getattr(self, f"{name}_high") is None):
                raise ValueError(f"the interval of {name} has only one end")
        return self


class IntervalRecord(BaseModel):
    """Of a rate."""

    model_config = _OPEN
    rate: _Share | None
    low: _Share | None
    high: _Share | None


class RunRecord(BaseModel):
    """A run: what the tables and figures of several reports show of it."""

    model_config = _OPEN
    method: str
    intrinsics: str
    reference: str
    n: Count
    detected: Count
    solved: Count
    solved_interval: IntervalRecord
    false_detections: Count | None
    oracle: dict[str, StatisticsRecord]
    ellipse: dict[str, StatisticsRecord]

    @model_validator(mode="after")
    def _errors(self) -> RunRecord:
        needed = [(f"oracle.{m.column}", m.column in self.oracle) for m in HEADLINE]
        needed += [(f"ellipse.{name}", name in self.ellipse) for name in ELLIPSE_METRICS]
        missing = [name for name, there in needed if not there]
        if missing:
            raise ValueError(f"{missing[0]} is missing")
        return self


class DatasetRecord(BaseModel):
    """The dataset that was scored."""

    model_config = _OPEN
    dataset_id: str
    name: str | None
    seed: int | None
    frames: Count
    groups: dict[str, Count] = {}
    sweeps: dict[str, str] = {}
    sweep_levels: dict[str, list[float | str]] = {}
    developed_from: Digest | None = None
    radiance_of: RadianceRecord | None = None

    @model_validator(mode="after")
    def _names(self) -> DatasetRecord:
        if not set(self.sweep_levels) <= set(self.sweeps):
            raise ValueError("sweep_levels has a group that sweeps has not")
        return self


class SettingsRecord(BaseModel):
    """Settings of the validator."""

    model_config = _OPEN
    reprojection_extent_D: Annotated[float, Field(gt=0, allow_inf_nan=False)]


class VersionsRecord(BaseModel):
    """Versions of software."""

    model_config = _OPEN
    validate_: dict[str, str] = Field(alias="validate")

    @model_validator(mode="after")
    def _ours(self) -> VersionsRecord:
        if "roundel" not in self.validate_:
            raise ValueError("validate.roundel is missing")
        return self


class SummaryRecord(BaseModel):
    """summary.json of this version's schema."""

    model_config = _OPEN
    metric_version: int
    dataset: DatasetRecord
    settings: SettingsRecord
    runs: list[RunRecord]
    versions: VersionsRecord
    checksums: dict[str, Digest]
