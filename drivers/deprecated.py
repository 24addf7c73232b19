"""Deprecated names: modules, names and attributes of version 0.1.0 that lab files and plug-ins may still use.

Nothing is installed by importing this module. Loaders of a lab's code call `install`; a class whose members were renamed
carries the decorator `renamed`. Each use of an old name gives a DeprecationWarning with the new one.
"""

import functools
import inspect
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

MODULES = {
    "drivers.burst_dialect": "drivers.generators.burst_generator BurstDialect=BurstGenerator",
    "drivers.burst_generator": "drivers.generators.burst_generator SMALLEST_VPP=IDLE_AMPLITUDE_VPP",
    "drivers.closing": "drivers.closing Closing=Closeable",
    "drivers.dc_supply": "drivers.supplies.dc_supply",
    "drivers.descent": "drivers.transport.safe_ramp_down Descent=RampDown",
    "drivers.errors": "drivers.errors DriveRefused=DriveRejectedError",
    "drivers.keyence_lkg": "drivers.sensors.keyence_lkg",
    "drivers.keysight_33200": "drivers.generators.keysight_33200",
    "drivers.keysight_33500": "drivers.generators.keysight_33500",
    "drivers.nidaq": "drivers.nidaq.analog_input NiLink=NiConnection cards=list_devices",
    "drivers.nidaq_output": "drivers.nidaq.analog_output NiOutput=NiAnalogOutput",
    "drivers.optoncdt": "drivers.sensors.optoncdt",
    "drivers.ports": "drivers.interfaces Choosy=DriveChecker",
    "drivers.rendering": "drivers.nidaq.rendering rate_for=sample_rate_for count_of=sample_count rendered=render_samples resting_v=idle_level_after_stop_v dying=fade_out",
    "drivers.rigol_dg": "drivers.generators.rigol_dg",
    "drivers.scpi": "drivers.transport.scpi Scpi=ScpiSession",
    "drivers.scpi_burst": "drivers.generators.scpi_burst_generator",
    "drivers.sensor": "drivers.sensors.laser_sensor",
    "drivers.sensor_presets": "drivers.sensors.laser_sensor Preset=SensorPreset",
    "drivers.serial_line": "drivers.transport.serial_port SerialLine=SerialPort ports=list_serial_ports",
    "drivers.setting": "drivers.generators.expected_setting Setting=ExpectedSetting word=expect_keyword near=expect_value between=expect_range",
    "drivers.siglent_sdg": "drivers.generators.siglent_sdg",
    "drivers.supply_dialects": "drivers.supplies.dialects Dialect=SupplyDialect",
    "drivers.supply_stairs": "drivers.supplies.dc_supply Stairs=StaircaseThread",
    "drivers.supply_wire": "drivers.supplies.dialects SupplyWire=SupplyChannel",
    "drivers.tektronix_afg": "drivers.generators.tektronix_afg",
    "drivers.visa": "drivers.transport.visa resources=list_resources",
    "drivers.waveform": "drivers.generators.arbitrary_waveform Shaped=ArbitraryDrive SINE=SINE_CYCLE cannot_hold=reason_memory_too_small points_needed=required_points rendered=render_waveform block=definite_length_block",
    "protocols.compliance": "protocols.measurements.load_point Value=ValueWithError estimates=compliance_estimates",
    "protocols.deflections": "protocols.measurements.voltage_steps slope=deflection_per_volt creep_share=relative_creep",
    "protocols.events": "protocols.base.events Status=RunStatus Armed=BenchArmed BlockTaken=BlockStored BlockSeen=BlockDiscarded EntryBegan=EntryStarted Playing=DriveStarted SettleEnded=SettlingFinished Recorded=RecordingFinished Paused=RunPaused Resumed=RunResumed Progressed=ProgressUpdated Asked=PromptShown Answered=PromptAnswered Noted=LogMessage FaultSwitched=InjectedFaultChanged GoingToRest=ShutdownStarted AtRest=RestMeasured",
    "protocols.figures": "protocols.base.rounding figures=format_with_uncertainty",
    "protocols.free_decay": "protocols.measurements.free_decay",
    "protocols.hysteresis": "protocols.measurements.hysteresis Folded=FoldedCycles",
    "protocols.load_point": "protocols.measurements.load_point",
    "protocols.mass_resonance": "protocols.measurements.mass_resonance",
    "protocols.membrane_sag": "protocols.measurements.membrane_sag",
    "protocols.membrane_series": "protocols.measurements.membrane_series label_of=elongation_label",
    "protocols.operator": "protocols.base.operator",
    "protocols.plain": "protocols.base.jsonable plain=to_jsonable",
    "protocols.protocol": "protocols.base.protocol extended=extend_plan",
    "protocols.quality": "protocols.base.quality usable=usable_mask",
    "protocols.resonance": "protocols.measurements.sine_dwell",
    "protocols.response_curve": "protocols.measurements.response_curve response_curve=frequency_response_curve must_respond=check_response_present",
    "protocols.signals.creep": "protocols.signals.creep Creep=CreepFit",
    "protocols.signals.decay": "protocols.signals.decay Decay=DecayFit",
    "protocols.signals.landing": "protocols.signals.step_detection LandingState=StepDetectionState Landing=WeightStep LandingDetector=WeightStepDetector",
    "protocols.signals.level": "protocols.signals.levels Level=LevelEstimate StepValue=StepEstimate level=estimate_level step_value=estimate_step combined=combine_errors",
    "protocols.signals.lines": "protocols.signals.spectral_blocks Blocks=BlockAverager bins_of=band_spectrum padded=fast_length blocks_for=make_block_averager pooled=pool_lines",
    "protocols.signals.loop": "protocols.signals.loop Loop=HysteresisLoop",
    "protocols.signals.mode": "protocols.signals.modal_fit Mode=ModalFit fit_mode=fit_sdof",
    "protocols.signals.peak": "protocols.signals.peak Peak=SpectralPeak",
    "protocols.signals.periodic_response": "protocols.signals.periodic_response periodic_response=estimate_periodic_response",
    "protocols.signals.ramp": "protocols.signals.levels Ramped=DetectedRamp",
    "protocols.signals.recorded_sweep": "protocols.signals.swept_response driven=sweep_extent rises=is_rising stands_out=check_drive_in_band",
    "protocols.signals.repeating": "protocols.signals.periodic_response repeating_share=repeating_error_share",
    "protocols.signals.response": "protocols.signals.response joined=concatenate_responses",
    "protocols.signals.samples": "protocols.signals.checks check_both=check_pair",
    "protocols.signals.swept_response": "protocols.signals.swept_response sweep_response=estimate_swept_response",
    "protocols.sine_dwell": "protocols.measurements.sine_dwell halved=refinement_frequencies percent=format_percent",
    "protocols.sine_point": "protocols.measurements.sine_dwell",
    "protocols.static_loading": "protocols.measurements.static_loading",
    "protocols.steps": "protocols.base.steps Await=WaitForDetection Awaited=DetectionResult Settled=SettlingResult Note=Log Redo=Repeat Read=ReadMeter Answer=StepResult",
    "protocols.sweep": "protocols.measurements.sweep",
    "protocols.values": "protocols.base.records Planned=PlanEntry Estimate=EstimatedQuantity Curve=ResultCurve Column=CurveColumn LongRecording=StreamedRecording too_long=recording_too_long_message",
    "protocols.voltage_steps": "protocols.measurements.voltage_steps",
    "protocols.weight_prompts": "protocols.measurements.load_point Landed=WeightStepWatcher turn_side=turn_side_prompt place=place_weight_prompt lift=remove_weight_prompt doubt=repeat_or_keep_prompt",
    "protocols.weights": "protocols.measurements.weights grams=format_grams",
    "protocols.wiring_check": "protocols.measurements.wiring_check",
    "sim_hardware.analog_output": "sim_hardware.nidaq.analog_output Samples=SampledSegment AnalogOutput=SimulatedAnalogOutput counts_of=to_counts",
    "sim_hardware.bench": "sim_hardware.bench VirtualBench=SimulatedBench",
    "sim_hardware.card": "sim_hardware.nidaq.card Card=SimulatedCard RateRefusedError=SampleRateError convert_time=convert_interval_s",
    "sim_hardware.contract.digitizers": "sim_hardware.testing.digitizer_contract Made=DigitizerUnderTest",
    "sim_hardware.contract.sources": "sim_hardware.testing.source_contract Made=SourceUnderTest live=energised strayed=largest_deviation_v",
    "sim_hardware.contract.volts": "sim_hardware.testing.safe_volts volts_are_safe=assert_safe_voltage",
    "sim_hardware.digitizer": "sim_hardware.nidaq.in_process_digitizer SimDigitizer=SimulatedDigitizer SimStream=SimulatedStream",
    "sim_hardware.direct": "sim_hardware.wires.in_process_link DirectLink=InProcessLink",
    "sim_hardware.faults": "sim_hardware.plant.faults Faults=FaultState",
    "sim_hardware.generator": "sim_hardware.generators.generator Make=SegmentFactory Settings=GeneratorSettings Generator=SimulatedGenerator",
    "sim_hardware.generators": "sim_hardware.generators.registry Box=GeneratorModel box=make_generator",
    "sim_hardware.history": "sim_hardware.plant.voltage_history Piece=HistoryEntry History=VoltageHistory",
    "sim_hardware.keysight_33200": "sim_hardware.generators.keysight_33200 Keysight33200=SimulatedKeysight33200",
    "sim_hardware.keysight_33500": "sim_hardware.generators.keysight_33500 KeysightBox=SimulatedKeysightGenerator Keysight33500=SimulatedKeysight33500",
    "sim_hardware.keysight_levels": "sim_hardware.generators.scpi_levels Levels=OutputLevels",
    "sim_hardware.plant": "sim_hardware.plant.plant Change=SetupChange",
    "sim_hardware.rigol_dg": "sim_hardware.generators.rigol_dg RigolDg=SimulatedRigolDg",
    "sim_hardware.scpi": "sim_hardware.wires.scpi_engine Engine=ScpiEngine Instrument=ScpiInstrument Command=ScpiCommand Answer=ScpiResponse split=split_message",
    "sim_hardware.scpi_blocks": "sim_hardware.wires.scpi_engine messages_in=split_received lift_blocks=extract_blocks put_back=restore_block",
    "sim_hardware.scpi_box": "sim_hardware.generators.scpi_generator ScpiBox=SimulatedScpiGenerator data_of=decode_block only=accept_keywords",
    "sim_hardware.scpi_values": "sim_hardware.wires.scpi_engine number=parse_number boolean=parse_boolean choice=match_keyword real=format_real one=single_argument",
    "sim_hardware.segments": "sim_hardware.plant.segments Level=ConstantSegment Open=ConstantSegment Wave=ArbitraryWaveform Tone=PeriodicSegment Chirp=ChirpSegment Glitch=RelayGlitchSegment",
    "sim_hardware.siglent_sdg": "sim_hardware.generators.siglent_sdg SiglentSdg=SimulatedSiglentSdg",
    "sim_hardware.supply": "sim_hardware.supplies.supply Relax=ExponentialSegment Supply=SimulatedSupply",
    "sim_hardware.supply_dialects": "sim_hardware.supplies.dialects SupplyModel=SimulatedScpiSupply SpdEngine=SiglentSpdEngine engine_of=make_supply_engine",
    "sim_hardware.tektronix_afg": "sim_hardware.generators.tektronix_afg TektronixAfg=SimulatedTektronixAfg",
    "sim_hardware.truth": "sim_hardware.plant.parameters BenchTruth=SimulationParameters GeneratorTruth=GeneratorParameters SupplyTruth=SupplyParameters AmplifierTruth=AmplifierParameters SensorTruth=SensorParameters CardTruth=CardParameters HandsTruth=OperatorTiming",
}
"""By the path of version 0.1.0: the module that has its content now, then the names that differ, each as old=new."""

SOURCE_METHODS = {
    "at_rest": "is_at_rest",
    "prepare": "initialize_at_rest",
    "play": "start_drive",
    "move": "ramp_to",
    "idle_v": "idle_level_v",
    "cannot": "reason_unsupported",
}
"""Methods of a `Source` (and of a `DriveChecker`) under their names of version 0.1.0."""

T = TypeVar("T")
P = ParamSpec("P")


def _warn(old: str, new: str, stacklevel: int = 3) -> None:
    warnings.warn(f"'{old}' is deprecated since version 0.1.0; use '{new}'", DeprecationWarning, stacklevel + 1)


class _OldModules(MetaPathFinder, Loader):
    """Resolves module paths of version 0.1.0, and old names in modules that kept their path."""

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname not in MODULES:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None:
            return ModuleSpec(fullname, self)
        if spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                add_old_names(module)

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec

    def exec_module(self, module: ModuleType) -> None:
        _warn(module.__name__, MODULES[module.__name__].split()[0])
        add_old_names(module)


def add_old_names(module: ModuleType) -> None:
    """Make the module resolve its names of version 0.1.0."""
    new_module, *pairs = MODULES[module.__name__].split()
    names = dict(pair.split("=") for pair in pairs)
    previous = vars(module).get("__getattr__")

    def resolve(name: str) -> Any:
        if name in names:
            _warn(f"{module.__name__}.{name}", f"{new_module}.{names[name]}")
        elif previous is not None:
            return previous(name)
        elif name.startswith("__") or module.__name__ == new_module:
            raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
        return getattr(import_module(new_module), names.get(name, name))

    vars(module)["__getattr__"] = resolve


def install() -> None:
    """Make imports of version 0.1.0 work from now on, in this process."""
    if any(isinstance(finder, _OldModules) for finder in sys.meta_path):
        return
    sys.meta_path.insert(0, _OldModules())
    for name in MODULES.keys() & sys.modules.keys():
        add_old_names(sys.modules[name])


class RenamedMember:
    """The old name of a method or attribute; reading and setting it warn and reach the new one."""

    def __init__(self, old: str, new: str) -> None:
        self.old, self.new = old, new

    def __get__(self, instance: Any, owner: type) -> Any:
        _warn(f"{owner.__name__}.{self.old}", self.new)
        adapted = [base for base in owner.__mro__ if vars(base).get(self.old, self) is not self]
        if not adapted:
            return getattr(owner if instance is None else instance, self.new)
        # Called by super(): an override under the old name is the new one as well, and must not call itself.
        for base in owner.__mro__:
            if base not in adapted and self.new in vars(base):
                member = vars(base)[self.new]
                return member.__get__(instance, owner) if hasattr(member, "__get__") else member
        raise AttributeError(f"'{owner.__name__}' has no attribute '{self.old}'")

    def __set__(self, instance: Any, value: Any) -> None:
        _warn(f"{type(instance).__name__}.{self.old}", self.new)
        setattr(instance, self.new, value)


def renamed(names: Mapping[str, str] | None = None, **more: str) -> Callable[[type[T]], type[T]]:
    """Decorate a class whose members had other names: `renamed(old="new")`. Subclasses may override the old ones."""

    def decorate(cls: type[T]) -> type[T]:
        aliases = {**(names or {}), **more}
        for old, new in aliases.items():
            setattr(cls, old, RenamedMember(old, new))

        def init_subclass(subclass: type, **options: Any) -> None:
            super(cls, subclass).__init_subclass__(**options)  # type: ignore[misc]
            for old, new in aliases.items():
                if old in vars(subclass) and new not in vars(subclass):
                    _adapt(subclass, old, new)

        cls.__init_subclass__ = classmethod(init_subclass)  # type: ignore[assignment, arg-type]
        return cls

    return decorate


def adapt(cls: type, names: Mapping[str, str], interface: type = object) -> None:
    """Give a class that was written for version 0.1.0 the new names of its members.

    The class itself is changed, not wrapped: the watchdog opens it again by its module and name.
    """
    for old, new in names.items():
        has_new = hasattr(cls, new) and getattr(cls, new) is not getattr(interface, new, None)
        if not has_new and not isinstance(inspect.getattr_static(cls, old, None), RenamedMember | None):
            _adapt(cls, old, new)


def adapt_driver(driver: type, interface: type) -> None:
    """Give a driver plug-in that was written for version 0.1.0 the new names of its interface, Source or Digitizer."""
    if not hasattr(interface, "stream"):
        adapt(driver, SOURCE_METHODS, interface)
        return
    original = getattr(driver, "stream", None)
    if original is None or hasattr(original, "adapted"):
        return

    @functools.wraps(original)
    def stream(*args: Any, **kwargs: Any) -> Any:
        opened = original(*args, **kwargs)
        if not hasattr(opened, "start_time_s"):
            _adapt(type(opened), "started_s", "start_time_s", property(lambda self: self.started_s))
        return opened

    vars(stream)["adapted"] = True
    setattr(driver, "stream", stream)  # noqa: B010


def _adapt(cls: type, old: str, new: str, member: Any = None) -> None:
    _warn(f"{cls.__name__}.{old}", new, 4)
    setattr(cls, new, inspect.getattr_static(cls, old) if member is None else member)


def renamed_parameters(**names: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorate a function whose keyword arguments had other names: `renamed_parameters(old="new")`."""

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            for old in names.keys() & kwargs.keys():
                _warn(old, names[old])
                kwargs[names[old]] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate
