"""Records of a run of one selector, from which the tables are made."""

from pathlib import Path
from statistics import mean, stdev

from fvs_engine.files.record import RecordT, read_record
from fvs_engine.records import Record


class ViewQuality(Record):
    """Quality of the render of one test view."""

    name: str
    psnr_db: float
    ssim: float
    lpips: float | None


class Repeat(Record):
    """Another model of the same views, trained by another seed: mean PSNR as in ``Evaluation``."""

    seed: int
    psnr_db: float
    unvisited_db: float | None


class Evaluation(Record):
    """The model after ``visited`` views, on the test views.

    ``registered`` of the visited views have a camera in the model. ``travel`` is the length of the path
    through all visited views, in the dataset's unit. ``aligned_only`` test views could not be localised in
    the model, so their cameras are those of the dataset, moved by the alignment (poses ``sfm``).

    ``unvisited_db``: mean PSNR of the views that may still be visited, at the dataset's poses, moved by the
    alignment where poses are estimated; None where none is left. ``repeats``: other models of the same views.
    ``flown``: by each vehicle after the initial views.
    """

    visited: int
    registered: int
    iterations: int
    gaussians: int
    travel: float
    psnr_db: float
    ssim: float
    lpips: float | None
    aligned_only: tuple[str, ...]
    views: tuple[ViewQuality, ...]
    unvisited_db: float | None = None
    repeats: tuple[Repeat, ...] = ()
    flown: tuple[float, ...] = ()

    @property
    def mean_psnr_db(self) -> float:
        """Mean PSNR on the test views, over all models of these views."""
        return mean((self.psnr_db, *(repeat.psnr_db for repeat in self.repeats)))

    @property
    def mean_unvisited_db(self) -> float | None:
        """The same on the unvisited views; None where it is not known of all models."""
        values = [self.unvisited_db, *(repeat.unvisited_db for repeat in self.repeats)]
        known = [value for value in values if value is not None]
        return mean(known) if len(known) == len(values) else None

    @property
    def training_sd_db(self) -> float | None:
        """Standard deviation of the PSNR on the test views over models of these views; None of one model."""
        return stdev((self.psnr_db, *(r.psnr_db for r in self.repeats))) if self.repeats else None


class RankCorrelation(Record):
    """Whether a selector ranks first what is rendered worst.

    ``all_candidates``: Spearman's rank correlation between the selector's scores of all unvisited views and
    the true errors of their renders; +1: it ranks the worst first. ``in_reach``: the same among those that
    the protocol lets it choose from. None where it is not defined: all scores equal, or fewer than three.
    ``scored`` of ``candidates`` had a score that may be compared with others' (status ``ranked``).
    """

    method: str
    all_candidates: float | None
    in_reach: float | None
    candidates: int
    scored: int


class Calibration(Record):
    """The rank correlations of several selectors, all at one model: that of ``visited`` views."""

    visited: int
    selectors: tuple[RankCorrelation, ...]


class TravelPoint(Record):
    """The ``visited`` views with which a run passed a share of its travel."""

    share: float
    visited: int


class Run(Record):
    """One selector with one seed, from its initial views to its last.

    ``order``: the visited views, as they were visited; the first ``initial`` were given. ``selection_s``:
    what each choice took, scoring included, training not. ``fallbacks``: how many choices had to be made
    without the selector's scores. ``stop``: why the run ended. ``worst_rms``: the largest root mean square
    distance between the dataset's camera centres and the model's after alignment, in the dataset's unit.
    ``time_limit_s``: the limit that ended it before its last view; None when something else did.
    ``stop_kind``: that of the ``StopReason``. ``vehicles``: which one flew to each chosen view (empty: the
    same to all). ``travel_points``: for each share of the travel that it went through, or would have if more
    views had been worth it; empty where travel is no budget.
    """

    method: str
    seed: int
    initial: int
    order: tuple[str, ...]
    evaluations: tuple[Evaluation, ...]
    calibrations: tuple[Calibration, ...]
    selection_s: tuple[float, ...]
    fallbacks: int
    worst_rms: float | None
    stop: str
    seconds: float
    time_limit_s: float | None = None
    stop_kind: str = ""
    vehicles: tuple[int, ...] = ()
    travel_points: tuple[TravelPoint, ...] = ()

    def may_go_on(self, time_limit_s: float | None) -> bool:
        """Whether the run ended because of a time limit shorter than ``time_limit_s`` (None: no limit)."""
        return self.time_limit_s is not None and (time_limit_s is None or time_limit_s > self.time_limit_s)

    def at(self, visited: int) -> Evaluation | None:
        """The evaluation after ``visited`` views; None without one."""
        return next((evaluation for evaluation in self.evaluations if evaluation.visited == visited), None)

    def at_share(self, share: float) -> Evaluation | None:
        """The evaluation at a share of the travel; None where the run did not get so far."""
        return next((self.at(point.visited) for point in self.travel_points if point.share == share), None)


def read_result(path: Path, kind: type[RecordT]) -> RecordT | None:
    """A record of a run, None when there is no file; raises ``StorageError`` for a damaged one."""
    return read_record(path, kind, "Delete this file: it will be made again.")
