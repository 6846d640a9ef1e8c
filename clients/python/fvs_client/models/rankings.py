"""Rankings."""

from fvs_client.models.display import ReprArgs, Table, pose_text, table_html, with_unit
from fvs_schema.rankings import RankedCandidate, Ranking


class RankingData(Ranking):
    """An immutable ranking, with the inputs to repeat it."""

    @property
    def best(self) -> RankedCandidate | None:
        """The first ranked candidate; None when none was ranked."""
        return next((candidate for candidate in self.candidates if candidate.rank is not None), None)

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("snapshot_id", self.snapshot_id))
        yield from (("method", self.request.method), ("candidates", len(self.candidates)))
        yield "best", None if self.best is None else self.best.id

    def _repr_html_(self) -> str:
        notes = [made_by(self), *(f"{one.message} {one.hint}" for one in self.warnings)]
        return table_html(ranking_table(self), f"Ranking {self.id}", notes)


def ranking_table(ranking: RankingData) -> Table:
    """The candidates of a ranking, as text."""
    distance = with_unit("distance", ranking.alignment)
    return Table(
        ("rank", "id", "score", "coverage", "chance", distance, "status", "pose"),
        tuple(
            (
                "" if item.rank is None else str(item.rank),
                item.id,
                "" if item.score is None else f"{'≈ ' * item.estimated}{item.score:.4g}",
                "" if item.coverage is None else f"{item.coverage:.0%}",
                "" if item.chance is None else f"{item.chance:.0%}",
                "" if item.distance_m is None else f"{item.distance_m:.2f}",
                item.status.value,
                pose_text(item.pose),
            )
            for item in ranking.candidates
        ),
        frozenset(("rank", "score", "coverage", "chance", distance)),
    )


def made_by(ranking: RankingData) -> str:
    """How a ranking was made, and what it leaves out, in a line."""
    more = ranking.total - len(ranking.candidates)
    rest = f"{more} more; " if more > 0 else ""
    fallback = f"; ranked by {ranking.fallback}, because the method could not" if ranking.fallback else ""
    return (
        f"{rest}by {ranking.request.method} on {ranking.snapshot_id}, {ranking.gaussians:,} Gaussians after "
        f"{ranking.iterations:,} iterations, in {ranking.seconds:.2f} s{fallback}"
    )
