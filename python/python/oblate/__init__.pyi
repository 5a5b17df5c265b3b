from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__: list[str]
__version__: str

Path: TypeAlias = str | PathLike[str]
Array: TypeAlias = NDArray[np.float64]
Columns: TypeAlias = dict[str, Array]
Setting: TypeAlias = bool | int | float | str | Sequence[Any] | Mapping[str, Any]
Coordinates: TypeAlias = Literal["theta", "u", "z"]
Event: TypeAlias = dict[str, Any]

class OblateError(ValueError): ...

class Marginal:
    @final
    class Uniform(Marginal):
        lo: float
        hi: float
        def __new__(cls, lo: float, hi: float) -> Marginal.Uniform: ...

    @final
    class Normal(Marginal):
        mean: float
        sd: float
        def __new__(cls, mean: float, sd: float) -> Marginal.Normal: ...

    @final
    class HalfNormal(Marginal):
        sd: float
        def __new__(cls, sd: float) -> Marginal.HalfNormal: ...

Uniform = Marginal.Uniform
Normal = Marginal.Normal
HalfNormal = Marginal.HalfNormal

@final
class Track:
    def __new__(
        cls,
        phi_deg: Sequence[float] | Array,
        r_kpc: Sequence[float] | Array,
        r_err_kpc: Sequence[float] | Array,
        *,
        bin_width_deg: float,
        name: str = "track",
    ) -> Track: ...
    @staticmethod
    def read(
        path: Path,
        *,
        assume_error: str | None = None,
        handedness: Literal["as-given", "mirrored"] | None = None,
    ) -> Track: ...
    @property
    def name(self) -> str: ...
    @property
    def bin_width_deg(self) -> float: ...
    @property
    def phi_deg(self) -> Array: ...
    @property
    def r_kpc(self) -> Array: ...
    @property
    def r_err_lo_kpc(self) -> Array: ...
    @property
    def r_err_hi_kpc(self) -> Array: ...
    @property
    def assumptions(self) -> list[str]: ...
    def __len__(self) -> int: ...

@final
class Model:
    def __new__(
        cls,
        *,
        config: Path | None = None,
        settings: Mapping[str, Setting] | None = None,
        threads: int | None = None,
    ) -> Model: ...
    def stream(self, parameters: Mapping[str, float]) -> dict[str, NDArray[Any]]: ...
    def track(self, parameters: Mapping[str, float], *, bin_width_deg: float = 10.0) -> Columns: ...

@final
class Fit:
    def __new__(
        cls,
        track: Path | Track,
        *,
        config: Path | None = None,
        settings: Mapping[str, Setting] | None = None,
        threads: int | None = None,
    ) -> Fit: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def dim(self) -> int: ...
    @property
    def fixed(self) -> dict[str, float]: ...
    @property
    def prior(self) -> dict[str, Marginal]: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def data(self) -> Track: ...
    def ln_likelihood(self, theta: ArrayLike, *, coordinates: Coordinates = "theta") -> Any: ...
    def gradient(self, theta: ArrayLike, *, coordinates: Coordinates = "theta") -> tuple[Any, Array]: ...
    def rejected(self, theta: ArrayLike, *, coordinates: Coordinates = "theta") -> Any: ...
    def ln_prior(self, theta: ArrayLike) -> Any: ...
    def prior_transform(self, u: ArrayLike) -> Array: ...
    def theta_from_z(self, z: ArrayLike) -> Array: ...
    def z_from_theta(self, theta: ArrayLike) -> Array: ...
    def derived(self, theta: ArrayLike) -> dict[str, Any]: ...
    def track(self, theta: ArrayLike) -> Columns: ...
    def stream(self, theta: ArrayLike) -> dict[str, NDArray[Any]]: ...
    def sample(
        self,
        *,
        out: Path | None = None,
        if_exists: Literal["refuse", "replace", "resume"] = "refuse",
        seed: int | None = None,
        max_minutes: float | None = None,
        on_event: Callable[[Event], object] | None = None,
    ) -> Run: ...

@final
class Run:
    @staticmethod
    def read(folder: Path) -> Run: ...
    @property
    def method(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def theta(self) -> Array: ...
    @property
    def ln_likelihood(self) -> Array: ...
    @property
    def ln_weight(self) -> Array: ...
    @property
    def derived(self) -> Columns: ...
    @property
    def ln_z(self) -> float: ...
    @property
    def ln_z_error(self) -> float: ...
    @property
    def ess(self) -> float: ...
    @property
    def calls(self) -> int: ...
    @property
    def rejected(self) -> dict[str, int]: ...
    @property
    def converged(self) -> bool: ...
    @property
    def checks(self) -> list[dict[str, Any]]: ...
    @property
    def warnings(self) -> list[str]: ...
    def to_pandas(self, *, weighted: bool = False) -> Any: ...
    def __len__(self) -> int: ...

@overload
def sample(
    ln_likelihood: Callable[[Array], float],
    prior: Mapping[str, Marginal],
    *,
    gradient: Callable[[Array], tuple[float, ArrayLike]] | None = None,
    vectorized: Literal[False] = False,
    sampler: Literal["nested", "pt-hmc"] = "nested",
    settings: Mapping[str, Setting] | None = None,
    seed: int = 1,
    max_calls: int | None = None,
    threads: int = 1,
    on_event: Callable[[Event], object] | None = None,
) -> Run: ...
@overload
def sample(
    ln_likelihood: Callable[[Array], Any],
    prior: Mapping[str, Marginal] | Callable[[Array], ArrayLike],
    *,
    names: Sequence[str] | None = None,
    gradient: Callable[[Array], tuple[float, ArrayLike]] | None = None,
    vectorized: bool = False,
    sampler: Literal["nested", "pt-hmc"] = "nested",
    settings: Mapping[str, Setting] | None = None,
    seed: int = 1,
    max_calls: int | None = None,
    threads: int = 1,
    on_event: Callable[[Event], object] | None = None,
) -> Run: ...
def load(folder: Path) -> Any: ...
def load_arviz(folder: Path) -> Any: ...
