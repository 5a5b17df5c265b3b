from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

__all__ = ["Fit", "Marginal", "Model", "OblateError", "Run", "Track", "_restore_fit", "__version__", "sample"]

__version__: str

_Path: TypeAlias = str | PathLike[str]
_Array: TypeAlias = NDArray[np.float64]
_Columns: TypeAlias = dict[str, _Array]
_Setting: TypeAlias = bool | int | float | str | Sequence[Any] | Mapping[str, Any]
_Coordinates: TypeAlias = Literal["theta", "u", "z"]
_Event: TypeAlias = dict[str, Any]

class OblateError(ValueError): ...

@disjoint_base
class Marginal:
    @final
    class Uniform(Marginal):
        __match_args__ = ("lo", "hi")
        lo: float
        hi: float
        def __new__(cls, lo: float, hi: float) -> Marginal.Uniform: ...

    @final
    class Normal(Marginal):
        __match_args__ = ("mean", "sd")
        mean: float
        sd: float
        def __new__(cls, mean: float, sd: float) -> Marginal.Normal: ...

    @final
    class HalfNormal(Marginal):
        __match_args__ = ("sd",)
        sd: float
        def __new__(cls, sd: float) -> Marginal.HalfNormal: ...

@final
class Track:
    def __new__(
        cls,
        phi_deg: Sequence[float] | _Array,
        r_kpc: Sequence[float] | _Array,
        r_err_kpc: Sequence[float] | _Array,
        *,
        bin_width_deg: float,
        name: str = "track",
        v_km_s: Sequence[float] | _Array | None = None,
        v_err_km_s: Sequence[float] | _Array | None = None,
        width_kpc: Sequence[float] | _Array | None = None,
        width_err_kpc: Sequence[float] | _Array | None = None,
        density_per_deg: Sequence[float] | _Array | None = None,
        density_err_per_deg: Sequence[float] | _Array | None = None,
    ) -> Track: ...
    @staticmethod
    def read(
        path: _Path,
        *,
        assume_error: str | None = None,
        handedness: Literal["as-given", "mirrored"] | None = None,
    ) -> Track: ...
    @property
    def name(self) -> str: ...
    @property
    def bin_width_deg(self) -> float: ...
    @property
    def phi_deg(self) -> _Array: ...
    @property
    def r_kpc(self) -> _Array: ...
    @property
    def r_err_lo_kpc(self) -> _Array: ...
    @property
    def r_err_hi_kpc(self) -> _Array: ...
    @property
    def v_km_s(self) -> _Array | None: ...
    @property
    def v_err_km_s(self) -> _Array | None: ...
    @property
    def width_kpc(self) -> _Array | None: ...
    @property
    def width_err_kpc(self) -> _Array | None: ...
    @property
    def density_per_deg(self) -> _Array | None: ...
    @property
    def density_err_per_deg(self) -> _Array | None: ...
    @property
    def assumptions(self) -> list[str]: ...
    def __len__(self) -> int: ...

@final
class Model:
    def __new__(
        cls,
        *,
        config: _Path | None = None,
        settings: Mapping[str, _Setting] | None = None,
        threads: int | None = None,
    ) -> Model: ...
    def stream(self, parameters: Mapping[str, float]) -> dict[str, NDArray[Any]]: ...
    def track(self, parameters: Mapping[str, float], *, bin_width_deg: float = 10.0) -> _Columns: ...

@final
class Fit:
    def __new__(
        cls,
        track: _Path | Track,
        *,
        config: _Path | None = None,
        settings: Mapping[str, _Setting] | None = None,
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
    def ln_likelihood(self, theta: ArrayLike, *, coordinates: _Coordinates = "theta") -> Any: ...
    def gradient(self, theta: ArrayLike, *, coordinates: _Coordinates = "theta") -> tuple[Any, _Array]: ...
    def rejected(self, theta: ArrayLike, *, coordinates: _Coordinates = "theta") -> Any: ...
    def ln_prior(self, theta: ArrayLike) -> Any: ...
    def prior_transform(self, u: ArrayLike) -> _Array: ...
    def theta_from_z(self, z: ArrayLike) -> _Array: ...
    def z_from_theta(self, theta: ArrayLike) -> _Array: ...
    def derived(self, theta: ArrayLike) -> dict[str, Any]: ...
    def track(self, theta: ArrayLike) -> _Columns: ...
    def stream(self, theta: ArrayLike) -> dict[str, NDArray[Any]]: ...
    def sample(
        self,
        *,
        out: _Path | None = None,
        if_exists: Literal["refuse", "replace", "resume"] = "refuse",
        seed: int | None = None,
        max_minutes: float | None = None,
        on_event: Callable[[_Event], object] | None = None,
    ) -> Run: ...

@final
class Run:
    @staticmethod
    def read(folder: _Path) -> Run: ...
    @property
    def method(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def theta(self) -> _Array: ...
    @property
    def ln_likelihood(self) -> _Array: ...
    @property
    def ln_weight(self) -> _Array: ...
    @property
    def derived(self) -> _Columns: ...
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
    ln_likelihood: Callable[[_Array], float],
    prior: Mapping[str, Marginal],
    *,
    gradient: Callable[[_Array], tuple[float, ArrayLike]] | None = None,
    vectorized: Literal[False] = False,
    sampler: Literal["nested", "pt-hmc"] = "nested",
    settings: Mapping[str, _Setting] | None = None,
    seed: int = 1,
    max_calls: int | None = None,
    threads: int = 1,
    on_event: Callable[[_Event], object] | None = None,
) -> Run: ...
@overload
def sample(
    ln_likelihood: Callable[[_Array], Any],
    prior: Mapping[str, Marginal] | Callable[[_Array], ArrayLike],
    *,
    names: Sequence[str] | None = None,
    gradient: Callable[[_Array], tuple[float, ArrayLike]] | None = None,
    vectorized: bool = False,
    sampler: Literal["nested", "pt-hmc"] = "nested",
    settings: Mapping[str, _Setting] | None = None,
    seed: int = 1,
    max_calls: int | None = None,
    threads: int = 1,
    on_event: Callable[[_Event], object] | None = None,
) -> Run: ...
def _restore_fit(track: str, settings: str, threads: int | None) -> Fit: ...
