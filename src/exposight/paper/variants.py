"""The model variants: what each learns from, and which rows evaluate it.

Sects. 3.3 and 3.4 of the paper add one thing after the other to a model; Sect. 4 takes the best of
them to other lighting, another sensor and other finishes. All lines of Tables 2 to 6 are here, and
beside every validation on a random split one on a split by whole views. Names are plain:
``e_k6_star`` is ᵉk₆*, and those of the stereo sensor end with ``_s2``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

from exposight.models import ModelSpecification, model_named, product_kernel
from exposight.paper.datasets import OUTSIDE, POSE, POSITION
from exposight.paper.study_settings import SensorKind

EvaluationRole = Literal["validation", "validation_by_view", "test", "test_inside", "extended"]
"""How evaluation rows relate to those trained on.

``validation``: the rest of the random split, as in the paper. ``validation_by_view``: the rest of a
split by whole views. ``test``: unseen features. ``test_inside``: of these, the rows inside the
training rows' box in x, y, z, w, p (the paper's "test,i"). ``extended``: Sects. 4.1 and 4.3.
"""

_Test: TypeAlias = Literal["test", "test_inside"]

_BOTH: Final[tuple[_Test, ...]] = ("test", "test_inside")

_FINISHES = (
    ("f1-5_out", ()),
    ("f1_out", OUTSIDE[:1]),
    ("f2-3_out", OUTSIDE[1:3]),
    ("f4-5_out", OUTSIDE[3:]),
)
"""Features by finish (Sect. 4.3.1): all, then the three groups."""


@dataclass(frozen=True, kw_only=True)
class EvaluationSet:
    """Rows on which a variant is evaluated: one line of Tables 2 to 6.

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    dataset : str
        Name of the `Dataset` that the rows come from; for validation the variant's own.
    role : str
        See `EvaluationRole`.
    paper_dataset : str
        As in the paper's table, for instance ``eX6_val_plusplus``.
    features : tuple of str
        Only these; empty for all of the dataset's.
    paper_features : str
        As in the paper's table, for instance ``f1-4_test``.
    inside : tuple of str
        Only rows inside the training rows' range in these columns, at the resolution of Table 9,
        whole mm and degrees; empty for all rows.
    """

    table: int
    dataset: str
    role: EvaluationRole
    paper_dataset: str
    paper_features: str
    features: tuple[str, ...] = ()
    inside: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A model of the study: its form, the dataset it learns from, the rows that evaluate it.

    Parameters
    ----------
    name : str
        As the paper names the kernel: ``q_k4``, ``e_k4_plus``, ``e_k6_plusplus``, ``q_k4_s2``, …
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    specification : ModelSpecification
        Target, inputs and kernel.
    dataset : str
        Name of the dataset whose training side it learns from.
    evaluations : tuple of EvaluationSet
        In the order of the paper's tables.
    """

    name: str
    title: str
    sensor: SensorKind
    specification: ModelSpecification
    dataset: str
    evaluations: tuple[EvaluationSet, ...]

    @property
    def unit(self) -> Literal["%", "ms"]:
        """Unit of RMSE and MAE in tables: percent of full scale for p_norm, ms for exposures."""
        return "%" if self.specification.target == "p_norm" else "ms"


def _variant(
    name: str,
    title: str,
    dataset: str,
    table: int,
    specification: ModelSpecification,
    *,
    paper: str,
    suffix: str = "",
    tests: tuple[_Test, ...] = ("test",),
    further: tuple[EvaluationSet, ...] = (),
) -> Variant:
    """Make a variant with its lines of Tables 2, 3 or 5.

    Parameters
    ----------
    name, title, dataset : str
        As in `Variant`.
    table : int
        The paper's table.
    specification : ModelSpecification
        Renamed here.
    paper : str
        How the paper begins the names of its datasets, with the number of inputs: ``eX4``.
    suffix : str
        How the validation dataset's name ends: ``_plus`` for ᵉX⁺.
    tests : tuple of {'test', 'test_inside'}
        Which unseen rows evaluate it.
    further : tuple of EvaluationSet
        Lines of Tables 4 and 6.
    """
    sensor: SensorKind = "stereo" if dataset.startswith("s2_") else "structured-light"
    unseen = ("s2_" if sensor == "stereo" else "") + paper.rstrip("0123456789") + "_test"
    validations = _validations(table, dataset, f"{paper}_val{suffix}", plus=bool(suffix))
    return Variant(
        name=name,
        title=title,
        sensor=sensor,
        specification=replace(specification, name=name, title=title),
        dataset=dataset,
        evaluations=(*validations, *_tests(table, unseen, f"{paper}_test", tests), *further),
    )


def _validations(
    table: int, dataset: str, paper_dataset: str, *, plus: bool
) -> Iterator[EvaluationSet]:
    """Yield the line of the random split, then that of the split by whole views."""
    roles: tuple[tuple[EvaluationRole, str], ...]
    roles = (("validation", ""), ("validation_by_view", "_by_view"))
    for role, ending in roles:
        yield EvaluationSet(
            table=table,
            dataset=dataset,
            role=role,
            paper_dataset=f"{paper_dataset}{ending}",
            paper_features="f1-9" if plus else "f1-4",
        )


def _tests(
    table: int, dataset: str, paper_dataset: str, roles: tuple[_Test, ...]
) -> Iterator[EvaluationSet]:
    """Yield the lines of unseen features: all their rows, those inside the training range."""
    for role in roles:
        inside = role == "test_inside"
        yield EvaluationSet(
            table=table,
            dataset=dataset,
            role=role,
            paper_dataset=f"{paper_dataset}_i" if inside else paper_dataset,
            paper_features="f1-4_test",
            inside=POSE if inside else (),
        )


def _lighting() -> tuple[EvaluationSet, ...]:
    """Return the lines of Table 4."""
    return tuple(
        EvaluationSet(
            table=4,
            dataset=f"X_lighting_{scenario}",
            role="extended",
            paper_dataset=f"X_lighting_{scenario}",
            paper_features="f1-3_test",
        )
        for scenario in ("I", "II", "III")
    )


def _outside(dataset: str, paper_dataset: str) -> tuple[EvaluationSet, ...]:
    """Return the lines of Table 6: rows inside the training rows' spatial range (Sect. 4.3.1).

    The range of positions alone: Table 9's orientations outside lie beyond those trained on.
    """
    return tuple(
        EvaluationSet(
            table=6,
            dataset=dataset,
            role="extended",
            paper_dataset=paper_dataset,
            paper_features=label,
            features=features,
            inside=POSITION,
        )
        for label, features in _FINISHES
    )


def _quality() -> tuple[Variant, ...]:
    first = tuple(
        _variant(f"q_k{d}", f"quality, {d}D", "X", 2, model_named(f"q_k{d}"), paper=f"X{d}")
        for d in (1, 2, 3)
    )
    return (
        *first,
        _variant(
            "q_k4",
            "quality, 4D",
            "X",
            2,
            model_named("q_k4"),
            paper="X4",
            further=(*_lighting(), *_outside("X_out", "X_out")),
        ),
        _variant("q_k6", "quality, 6D", "X", 2, model_named("q_k6"), paper="X6"),
    )


def _exposure_time() -> tuple[Variant, ...]:
    first = tuple(
        _variant(f"e_k{d}", f"exposure time, {d}D", "eX", 3, model_named(f"e_k{d}"), paper=f"eX{d}")
        for d in (1, 2, 3)
    )
    later = tuple(
        _variant(
            name,
            f"exposure time, {title}",
            f"eX{suffix}",
            3,
            model_named(model),
            paper=f"eX{model[3]}",
            suffix=suffix,
            tests=_BOTH,
            further=(*_lighting(), *_outside("X_out", "eX_out")) if name == "e_k6" else (),
        )
        for name, title, model, suffix in (
            ("e_k4", "4D", "e_k4", ""),
            ("e_k4_plus", "4D, more features", "e_k4", "_plus"),
            ("e_k6_plus", "6D, more features", "e_k6_plus", "_plus"),
            ("e_k6_plusplus", "6D, finer steps", "e_k6_plus", "_plusplus"),
            ("e_k6_star", "6D ARD", "e_k6_star", "_plusplus"),
            ("e_k6", "6D product", "e_k6", "_plusplus"),
            ("e_k6_lin", "6D linear", "e_k6_lin", "_plusplus"),
        )
    )
    return (*first, *later)


def _stereo() -> tuple[Variant, ...]:
    # Table 8: the stereo sensor's 4D kernel is a product too, with a length scale for each input.
    e_k4 = model_named("e_k4")
    product_4d = replace(e_k4, kernel=product_kernel(len(e_k4.inputs)), source="Sect. 4.2.3")
    return tuple(
        _variant(
            name,
            f"stereo, {title}",
            dataset,
            5,
            specification,
            paper=paper,
            tests=_BOTH if further or name == "q_k6_s2" else ("test",),
            further=further,
        )
        for name, title, dataset, paper, specification, further in (
            ("q_k1_s2", "quality, 1D", "s2_X", "X1", model_named("q_k1"), ()),
            (
                "q_k4_s2",
                "quality, 4D",
                "s2_X",
                "X4",
                model_named("q_k4"),
                _outside("s2_X_out", "X_s2_out"),
            ),
            ("q_k6_s2", "quality, 6D", "s2_X", "X6", model_named("q_k6"), ()),
            ("e_k1_s2", "exposure time, 1D", "s2_eX", "eX1", model_named("e_k1"), ()),
            ("e_k4_s2", "exposure time, 4D product", "s2_eX", "eX4", product_4d, ()),
            (
                "e_k6_s2",
                "exposure time, 6D product",
                "s2_eX",
                "eX6",
                model_named("e_k6"),
                _outside("s2_X_out", "eX_s2_out"),
            ),
        )
    )


VARIANTS: Final = (*_quality(), *_exposure_time(), *_stereo())
"""All variants, in the order of Tables 2, 3 and 5."""

LEARNING_CURVES: Final[Mapping[str, EvaluationRole]] = {"q_k4": "test", "e_k6": "test_inside"}
"""Variants whose learning curves are Figs. 22 and 23, and the rows that evaluate them."""
