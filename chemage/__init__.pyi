# Made by `chemage plugins stubs`; do not edit.
from collections.abc import Sequence
from typing import Any, Literal, overload

from chemage.foundation.units import QuantityLike
from chemage.studies.arrhenius import ActivationEnergy as ActivationEnergy
from chemage.ageing.methods import AgedBonds as AgedBonds
from chemage.ageing.methods import AgeingMethod as AgeingMethod
from chemage.ageing.methods import AgeingRequest as AgeingRequest
from chemage.ageing.aging import Aging as Aging
from chemage.studies.arrhenius import Arrhenius as Arrhenius
from chemage.lattices.role import Barriers as Barriers
from chemage.kinetics.history import BondHistory as BondHistory
from chemage.friction.role import Bonded as Bonded
from chemage.foundation.errors import ChemageError as ChemageError
from chemage.lattices.chemistry import Chemistry as Chemistry
from chemage.plugins.options import Choice as Choice
from chemage.plugins.options import Choice as Choice
from chemage.studies.sweeps.result import Collected as Collected
from chemage.foundation.components import Component as Component
from chemage.contacts.options import ContactModulus as ContactModulus
from chemage.lattices.site_grid import ContactSites as ContactSites
from chemage.contacts.solution import ContactSolution as ContactSolution
from chemage.contacts.role import ContactSolver as ContactSolver
from chemage.contacts.solution import ContactStatistics as ContactStatistics
from chemage.contacts.role import ContactTheory as ContactTheory
from chemage.foundation.errors import ConvergenceError as ConvergenceError
from chemage.foundation.errors import DamagedError as DamagedError
from chemage.foundation.units import EV_PER_GPA_NM3 as EV_PER_GPA_NM3
from chemage.foundation.units import Energy as Energy
from chemage.kinetics.role import Engine as Engine
from chemage.studies.ensembles.ensemble import Ensemble as Ensemble
from chemage.studies.ensembles.ensemble import ErrorPart as ErrorPart
from chemage.studies.ensembles.ensemble import Estimate as Estimate
from chemage.foundation.errors import ExecutorError as ExecutorError
from chemage.ageing.fitting import FIT_WINDOW as FIT_WINDOW
from chemage.foundation.units import FilePath as FilePath
from chemage.ageing.fitting import Fit as Fit
from chemage.foundation.units import Force as Force
from chemage.inference.forecast import Forecast as Forecast
from chemage.foundation.units import Frequency as Frequency
from chemage.surfaces.reading import HeightMap as HeightMap
from chemage.inference.result import Inference as Inference
from chemage.surfaces.reading import HeightMap as HeightMap
from chemage.inference.result import Inference as Inference
from chemage.foundation.errors import InputError as InputError
from chemage.lattices.role import Interaction as Interaction
from chemage.foundation.units import KB as KB
from chemage.foundation.units import Length as Length
from chemage.ageing.observables import Maps as Maps
from chemage.scene.materials import Material as Material
from chemage.scene.materials import MaterialValue as MaterialValue
from chemage.inference.curves import MeasuredCurve as MeasuredCurve
from chemage.ageing.measurements import Measurements as Measurements
from chemage.ageing.observables import Observable as Observable
from chemage.ageing.observables import Observed as Observed
from chemage.ageing.outputs import Output as Output
from chemage.foundation.errors import PlanWarning as PlanWarning
from chemage.ageing.observables import PlottedResult as PlottedResult
from chemage.foundation.errors import PlanWarning as PlanWarning
from chemage.ageing.observables import PlottedResult as PlottedResult
from chemage.foundation.errors import PluginError as PluginError
from chemage.plugins.options import PluginOptions as PluginOptions
from chemage.studies.sweeps.result import Point as Point
from chemage.foundation.units import Pressure as Pressure
from chemage.lattices.lattice import ReactionLattice as ReactionLattice
from chemage.surfaces.reading import Reader as Reader
from chemage.surfaces.surface import Roughness as Roughness
from chemage.scene.run import Run as Run
from chemage.friction.role import Rupture as Rupture
from chemage.friction.role import RuptureForce as RuptureForce
from chemage.surfaces.role import Scatter as Scatter
from chemage.friction.role import RuptureForce as RuptureForce
from chemage.surfaces.role import Scatter as Scatter
from chemage.scene.scene import Scene as Scene
from chemage.foundation.errors import SceneError as SceneError
from chemage.foundation.checks import Seed as Seed
from chemage.foundation.errors import StoreError as StoreError
from chemage.surfaces.surface import Surface as Surface
from chemage.surfaces.role import SurfaceMaker as SurfaceMaker
from chemage.studies.sweeps.result import SweepResult as SweepResult
from chemage.foundation.units import Temperature as Temperature
from chemage.foundation.units import Time as Time
from chemage.lattices.independent import TwoState as TwoState
from chemage.inference.result import UnexplainedError as UnexplainedError
from chemage.inference.result import UnexplainedError as UnexplainedError
from chemage.foundation.units import Unit as Unit
from chemage.foundation.errors import UnitError as UnitError
from chemage.foundation.errors import UnknownKindError as UnknownKindError
from chemage.foundation.units import Volume as Volume
from chemage.foundation.errors import WorkerLost as WorkerLost
from chemage.foundation.version import __version__ as __version__
from chemage.ageing.age import age as age
from chemage.results.arrhenius import arrhenius as arrhenius
from chemage.lattices.stage import build_lattice as build_lattice
from chemage.foundation.machine import cache_folder as cache_folder
from chemage.foundation.checks import check_times as check_times
from chemage.foundation.checks import checked_count as checked_count
from chemage.foundation.checks import checked_seed as checked_seed
from chemage.foundation.checks import checked_states as checked_states
from chemage.lattices.chemistry import chemistry as chemistry
from chemage.studies.sweeps.result import collect_sweep as collect_sweep
from chemage.contacts.options import contact_modulus as contact_modulus
from chemage.results.comparison import compare_files as compare_files
from chemage.contacts.options import contact_modulus as contact_modulus
from chemage.lattices.site_grid import contact_sites as contact_sites
from chemage.lattices.chemistry import contact_statistics as contact_statistics
from chemage.lattices.chemistry import contact_statistics as contact_statistics
from chemage.foundation.records import content_hash as content_hash
from chemage.foundation.units import convert as convert
from chemage.lattices.chemistry import coordination as coordination
from chemage.studies.ensembles.running import ensemble as ensemble
from chemage.ageing.fitting import fit_aging as fit_aging
from chemage.foundation.checks import force as force
from chemage.foundation.files import fresh_file as fresh_file
from chemage.plugins.registry import fromdict as fromdict
from chemage.ageing.hold_times import hold_times as hold_times
from chemage.plugins.hooks import hookimpl as hookimpl
from chemage.inference.infer import infer as infer
from chemage.contacts.patches import label_patches as label_patches
from chemage.scene.files import load_scene as load_scene
from chemage.studies.sweeps.result import load_sweep as load_sweep
from chemage.surfaces.stage import make_surface as make_surface
from chemage.scene.materials import material as material
from chemage.foundation.messages import nearest as nearest
from chemage.results.files import open_maps as open_maps
from chemage.scene.files import override as override
from chemage.scene.parsing import parse_scene as parse_scene
from chemage.plugins.options import plugin_options as plugin_options
from chemage.plugins.options import prefer_plugins as prefer_plugins
from chemage.results.files import open_maps as open_maps
from chemage.scene.files import override as override
from chemage.scene.parsing import parse_scene as parse_scene
from chemage.plugins.options import plugin_options as plugin_options
from chemage.plugins.options import prefer_plugins as prefer_plugins
from chemage.foundation.files import preflight as preflight
from chemage.results.files import read as read
from chemage.inference.curves import read_curves as read_curves
from chemage.ageing.measurements import read_measurements as read_measurements
from chemage.surfaces.reading import reader_for as reader_for
from chemage.plugins.registry import register as register
from chemage.foundation.files import regular_file as regular_file
from chemage.scene.run import run as run
from chemage.kinetics.stage import run_kinetics as run_kinetics
from chemage.friction.stage import rupture_bonds as rupture_bonds
from chemage.scene.files import scene_data as scene_data
from chemage.contacts.stage import solve_contact as solve_contact
from chemage.studies.sweeps.running import sweep as sweep
from chemage.foundation.checks import temperature_value as temperature_value
from chemage.plugins.registry import unregister as unregister
from chemage.scene.provenance import versions as versions
from chemage.results.files import write as write
from chemage.results.page import write_report as write_report
from chemage.foundation import container as container
from chemage.foundation import errors as errors
from chemage.foundation import figures as figures
from chemage.foundation import memory as memory
from chemage.cli import options as options
from chemage.foundation import progress as progress
from chemage.foundation import random as random
from chemage.plugins import registry as registry
from chemage.surfaces import roughness as roughness
from chemage.foundation import statistics as statistics
from chemage.foundation import tables as tables
from chemage import testing as testing
from chemage.foundation import text as text
from chemage.contacts import theory as theory
from chemage.foundation import threads as threads
from chemage.foundation import units as units

@overload
def surface(kind: Literal["from-file"], *, path: str, reader: Any = ..., pixel_size: QuantityLike | None = ..., height_unit: QuantityLike = ..., detrend: Literal['none', 'mean', 'plane'] = ..., periodic: bool | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["measured"], *, path: str, reader: Any = ..., height_unit: QuantityLike | None = ..., pixel_size: QuantityLike | Sequence[Any] | None = ..., crop: Sequence[Any] | None = ..., spikes: Literal['refuse', 'keep', 'interpolate'] = ..., spike_threshold: QuantityLike = ..., missing: Literal['refuse', 'interpolate'] = ..., detrend: Literal['none', 'mean', 'plane', 'quadratic'] = ..., resample: QuantityLike | None = ..., window: Literal['none', 'hann', 'mirror'] = ..., periodic: bool | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["roughened"], *, surface: Any, pixel_size: QuantityLike, hurst: QuantityLike | None = ..., cutoff: QuantityLike | None = ..., resolution: QuantityLike | None = ..., fit_from: QuantityLike | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["self-affine"], *, pixels: int | Sequence[Any], pixel_size: QuantityLike, hurst: QuantityLike, zeta: QuantityLike, eta: QuantityLike = ..., rms_slope: QuantityLike | None = ..., rms_height: QuantityLike | None = ...) -> SurfaceMaker: ...
@overload
def surface(kind: Literal["sphere"], *, radius: QuantityLike, pixels: int | Sequence[Any], pixel_size: QuantityLike) -> SurfaceMaker: ...

@overload
def contact(kind: Literal["fft-bem"], *, modulus: QuantityLike | dict[str, Any], tolerance: float = ..., pressure_tolerance: float | None = ..., precision: Literal['single', 'double', 'mixed'] = ..., boundary: Literal['auto', 'periodic', 'free'] = ..., levels: int | None = ..., max_iterations: int = ..., on_failure: Literal['raise', 'return'] = ..., gap: bool = ..., thickness: QuantityLike | None = ..., poisson_ratio: QuantityLike = ..., fft: Literal['scipy', 'ducc0', 'pyfftw', 'mkl_fft'] = ..., threads: int | None = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["hertz"], *, modulus: QuantityLike | dict[str, Any], gap: bool = ...) -> ContactSolver: ...
@overload
def contact(kind: Literal["persson"], *, modulus: QuantityLike | dict[str, Any], kappa: float | None = ...) -> ContactSolver: ...

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
def engine(kind: Literal["next-reaction"], *, threads: int = ..., superbasins: bool = ...) -> Engine: ...
@overload
def engine(kind: Literal["rejection-free"], *, superbasins: bool = ...) -> Engine: ...

def rupture(kind: Literal["mean-force"], *, bond_force: QuantityLike | None = ..., front_factor: float | None = ...) -> Rupture: ...

@overload
def observable(kind: Literal["barrier-spectrum"], *, lower: QuantityLike = ..., upper: QuantityLike = ..., bins: int = ...) -> Observable: ...
@overload
def observable(kind: Literal["pressure-spectrum"], *, upper: QuantityLike = ..., bins: int = ...) -> Observable: ...

@overload
def ageing_method(kind: Literal["closure"], *, accuracy: float = ..., engine: Any = ..., folder: str = ...) -> AgeingMethod: ...
@overload
def ageing_method(kind: Literal["sample"], *, share: QuantityLike, window: int = ..., margin: int = ...) -> AgeingMethod: ...
