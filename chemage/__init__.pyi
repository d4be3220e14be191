# Made by `chemage plugins stubs`; do not edit.
from collections.abc import Sequence
from typing import Any, Literal, overload

from chemage.foundation.units import QuantityLike
from chemage.foundation.names import __version__ as __version__
from chemage.ageing.ageing import Ageing as Ageing
from chemage.foundation.errors import ChemageError as ChemageError
from chemage.lattices.chemistry import Chemistry as Chemistry
from chemage.contacts.solution import ContactSolution as ContactSolution
from chemage.studies.ensembles.ensemble import Ensemble as Ensemble
from chemage_inference.forecast import Forecast as Forecast
from chemage_inference.result import Inference as Inference
from chemage.foundation.errors import InputError as InputError
from chemage_inference.curves import MeasuredCurve as MeasuredCurve
from chemage.ageing.measurements import Measurements as Measurements
from chemage.foundation.errors import PlanWarning as PlanWarning
from chemage.lattices.lattice import ReactionLattice as ReactionLattice
from chemage.scene.run import Run as Run
from chemage.scene.scene import Scene as Scene
from chemage.surfaces.surface import Surface as Surface
from chemage.studies.sweeps.result import SweepResult as SweepResult
from chemage_rate_state.traces import Trace as Trace
from chemage_trade.result import Tradeoff as Tradeoff
from chemage_inference.result import UnexplainedError as UnexplainedError
from chemage_validation.table import Validation as Validation
from chemage.ageing.age import age as age
from chemage.results.arrhenius import arrhenius as arrhenius
from chemage.lattices.chemistry import chemistry as chemistry
from chemage.studies.sweeps.result import collect_sweep as collect_sweep
from chemage.results.comparison import compare_files as compare_files
from chemage.contacts.options import contact_modulus as contact_modulus
from chemage.studies.ensembles.running import ensemble as ensemble
from chemage.foundation import errors as errors
from chemage.ageing.fitting import fit_ageing as fit_ageing
from chemage_rate_state.fit import fit_rate_state as fit_rate_state
from chemage.foundation.checks import hold_times as hold_times
from chemage_inference.infer import infer as infer
from chemage_live.page import Page as live
from chemage.scene.files import load_scene as load_scene
from chemage.studies.sweeps.result import load_sweep as load_sweep
from chemage.surfaces.role import make_surface as make_surface
from chemage.scene.materials import material as material
from chemage.results.files import open_maps as open_maps
from chemage.scene.files import parse_scene as parse_scene
from chemage import plugin as plugin
from chemage.plugins.options import plugin_options as plugin_options
from chemage.plugins.options import prefer_plugins as prefer_plugins
from chemage.results.files import read as read
from chemage_inference.curves import read_curves as read_curves
from chemage.ageing.measurements import read_measurements as read_measurements
from chemage_rate_state.traces import read_trace as read_trace
from chemage.plugins.registry import register as register
from chemage.scene.run import run as run
from chemage_rate_state.renewal import slip_length as slip_length
from chemage.contacts.role import solve_contact as solve_contact
from chemage.studies.sweeps.running import sweep as sweep
from chemage import testing as testing
from chemage_rate_state.traces import trace_of as trace_of
from chemage_trade.mapping import tradeoff as tradeoff
from chemage.plugins.registry import unregister as unregister
from chemage_validation.table import validate as validate
from chemage.results.files import write as write
from chemage.results.page import write_report as write_report
from chemage.ageing.methods import AgeingMethod
from chemage.lattices.role import Barriers
from chemage.contacts.role import ContactSolver
from chemage.kinetics.role import Engine
from chemage.lattices.role import Interaction
from chemage.ageing.observables import Observable
from chemage.friction.pulling import Pulling
from chemage.friction.role import Rupture
from chemage.surfaces.role import SurfaceMaker

@overload
def surface(kind: Literal["atoms"], *, file: str | None = ..., format: str | None = ..., index: int = ..., atoms: Any = ..., resolution: QuantityLike, probe_radius: QuantityLike = ..., radii: Literal['vdw', 'covalent'] = ..., sites: str = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["cone"], *, radius: QuantityLike, pixels: int | Sequence[Any], pixel_size: QuantityLike, half_angle: QuantityLike) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["from-file"], *, path: str, reader: Any = ..., pixel_size: QuantityLike | None = ..., height_unit: QuantityLike | None = ..., detrend: Literal['none', 'mean', 'plane'] = ..., periodic: bool | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["measured"], *, path: str, reader: Any = ..., height_unit: QuantityLike | None = ..., pixel_size: QuantityLike | Sequence[Any] | None = ..., crop: Sequence[Any] | None = ..., lines: Literal['none', 'differences', 'constant', 'linear', 'quadratic'] = ..., scars: Literal['keep', 'interpolate'] = ..., spikes: Literal['few', 'refuse', 'keep', 'interpolate'] = ..., spike_threshold: QuantityLike = ..., missing: Literal['few', 'refuse', 'interpolate'] = ..., detrend: Literal['none', 'mean', 'plane', 'quadratic'] = ..., resample: QuantityLike | None = ..., window: Literal['none', 'hann', 'mirror'] = ..., periodic: bool | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["roughened"], *, surface: Any, pixel_size: QuantityLike, hurst: QuantityLike | None = ..., cutoff: QuantityLike | None = ..., resolution: QuantityLike | None = ..., tip_radius: QuantityLike | None = ..., fit_from: QuantityLike | None = ..., member: int = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["self-affine"], *, pixels: int | Sequence[Any], pixel_size: QuantityLike, hurst: QuantityLike, zeta: QuantityLike, eta: QuantityLike = ..., rms_slope: QuantityLike | None = ..., rms_height: QuantityLike | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["sphere"], *, radius: QuantityLike, pixels: int | Sequence[Any], pixel_size: QuantityLike) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["spherical-cap"], *, radius: QuantityLike, pixels: int | Sequence[Any], pixel_size: QuantityLike) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["tip"], *, body: Any, apex: Literal['up', 'down'] = ..., own_roughness: Any = ..., roughness_seed: int | None = ..., counterface: Any = ..., counterface_seed: int | None = ..., place: Sequence[Any] | None = ..., depth: QuantityLike | None = ...) -> SurfaceMaker: ...

@overload
def contact(kind: Literal["adhesive-bem"], *, modulus: QuantityLike | dict[str, Any], hardness: QuantityLike | None = ..., boundary: Literal['auto', 'periodic', 'free'] = ..., levels: int | None = ..., on_failure: Literal['raise', 'return'] = ..., gap: bool = ..., thickness: QuantityLike | None = ..., poisson_ratio: QuantityLike = ..., substrate: Sequence[Any] | None = ..., threads: int | None = ..., work_of_adhesion: QuantityLike, range: QuantityLike, law: Literal['exponential', 'dugdale'] = ..., start: Literal['apart', 'contact'] = ..., tolerance: float = ..., coarse: Literal['refuse', 'note'] = ..., max_iterations: int = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["contactmechanics"], *, modulus: QuantityLike | dict[str, Any], tolerance: float = ..., max_iterations: int = ..., boundary: Literal['auto', 'periodic', 'free'] = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["dmt"], *, modulus: QuantityLike | dict[str, Any], work_of_adhesion: QuantityLike) -> ContactSolver: ...
@overload
def contact(kind: Literal["fft-bem"], *, modulus: QuantityLike | dict[str, Any], hardness: QuantityLike | None = ..., boundary: Literal['auto', 'periodic', 'free'] = ..., levels: int | None = ..., on_failure: Literal['raise', 'return'] = ..., gap: bool = ..., thickness: QuantityLike | None = ..., poisson_ratio: QuantityLike = ..., substrate: Sequence[Any] | None = ..., threads: int | None = ..., tolerance: float = ..., pressure_tolerance: float | None = ..., precision: Literal['single', 'double', 'mixed'] = ..., max_iterations: int = ..., fft: Literal['scipy', 'ducc0', 'pyfftw', 'mkl_fft'] = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["hertz"], *, modulus: QuantityLike | dict[str, Any], hardness: QuantityLike | None = ..., gap: bool = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["jkr"], *, modulus: QuantityLike | dict[str, Any], work_of_adhesion: QuantityLike) -> ContactSolver: ...
@overload
def contact(kind: Literal["maugis"], *, modulus: QuantityLike | dict[str, Any], work_of_adhesion: QuantityLike, range: QuantityLike) -> ContactSolver: ...
@overload
def contact(kind: Literal["persson"], *, modulus: QuantityLike | dict[str, Any], kappa: float | None = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["tamaas"], *, modulus: QuantityLike | dict[str, Any], tolerance: float = ..., max_iterations: int = ..., boundary: Literal['auto', 'periodic'] = ..., hardness: QuantityLike | None = ...) -> ContactSolver: ...

@overload
def barriers(kind: Literal["gaussian"], *, mean: QuantityLike, std: QuantityLike, lower: QuantityLike | None = ..., upper: QuantityLike | None = ...) -> Barriers: ...
@overload
def barriers(kind: Literal["inferred"], *, path: str, member: int = ...) -> Barriers: ...
@overload
def barriers(kind: Literal["md-silica"], *, member: int = ...) -> Barriers: ...
@overload
def barriers(kind: Literal["tabulated"], *, energies: Sequence[float] | None = ..., weights: Sequence[float] | None = ..., samples: Sequence[float] | None = ..., path: str | None = ..., energy_unit: QuantityLike = ...) -> Barriers: ...
@overload
def barriers(kind: Literal["uniform"], *, lower: QuantityLike, upper: QuantityLike) -> Barriers: ...

def interaction(kind: Literal["elastic-pairs"], *, strength: QuantityLike, bias: QuantityLike = ...) -> Interaction: ...

@overload
def engine(kind: Literal["auto"], *, threads: int = ..., superbasins: bool = ...) -> Engine: ...
@overload
def engine(kind: Literal["bkl"], *, superbasins: bool = ...) -> Engine: ...
@overload
def engine(kind: Literal["independent"], *, threads: int = ...) -> Engine: ...
@overload
def engine(kind: Literal["many-states"]) -> Engine: ...
@overload
def engine(kind: Literal["next-reaction"], *, threads: int = ..., superbasins: bool = ...) -> Engine: ...
@overload
def engine(kind: Literal["rejection-free"], *, superbasins: bool = ...) -> Engine: ...

@overload
def rupture(kind: Literal["bell"], *, transition_distance: QuantityLike, loading_rate: QuantityLike | None = ..., speed: QuantityLike | None = ..., stiffness: QuantityLike | None = ..., front_factor: float | None = ...) -> Rupture: ...
@overload
def rupture(kind: Literal["dudko-hummer-szabo"], *, transition_distance: QuantityLike, loading_rate: QuantityLike | None = ..., speed: QuantityLike | None = ..., stiffness: QuantityLike | None = ..., front_factor: float | None = ..., shape: Literal['cusp', 'cubic', 'constant'] = ...) -> Rupture: ...
@overload
def rupture(kind: Literal["friddle"], *, transition_distance: QuantityLike, loading_rate: QuantityLike | None = ..., speed: QuantityLike | None = ..., stiffness: QuantityLike | None = ..., front_factor: float | None = ..., shape: Literal['cusp', 'cubic', 'constant'] = ...) -> Rupture: ...
@overload
def rupture(kind: Literal["mean-force"], *, bond_force: QuantityLike | None = ..., front_factor: float | None = ...) -> Rupture: ...
@overload
def rupture(kind: Literal["pulled"], *, speed: QuantityLike, spring: QuantityLike | None = ..., friction: QuantityLike = ..., bond_stiffness: QuantityLike, transition_distance: QuantityLike, shape: Literal['cusp', 'cubic', 'constant'] = ..., partner: Literal['kept', 'renewed'] = ..., spacing: QuantityLike | None = ..., distance: QuantityLike, points: int = ..., frames: int = ..., engine: Any = ...) -> Rupture: ...

def pulling(kind: Literal["event-driven"], *, most_events: float = ...) -> Pulling: ...

@overload
def observable(kind: Literal["barrier-spectrum"], *, lower: QuantityLike = ..., upper: QuantityLike = ..., bins: int = ...) -> Observable: ...
@overload
def observable(kind: Literal["pressure-spectrum"], *, upper: QuantityLike = ..., bins: int = ...) -> Observable: ...

@overload
def ageing_method(kind: Literal["closure"], *, accuracy: float = ..., engine: Any = ..., folder: str = ...) -> AgeingMethod: ...
@overload
def ageing_method(kind: Literal["sample"], *, share: QuantityLike, window: int = ..., margin: int = ...) -> AgeingMethod: ...
