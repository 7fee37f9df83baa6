"""The C wrappers by their standards: which call is legal where, what a value may be, and what a
state holds.
"""

import ctypes
import gc
import re
import resource
import shutil
import subprocess
from ctypes import byref, c_bool, c_double, c_int, c_int32, c_int64, c_size_t, c_uint8, c_void_p
from pathlib import Path
from typing import Any

import pytest
from raw import (
    BOUNCES,
    COUNT,
    DER_V,
    DISCARD,
    DRAG,
    ERROR,
    FORCE,
    MASS,
    MEDIUM,
    OK,
    ON,
    TIME,
    WEIGHT,
    A,
    H,
    Raw,
    V,
    Y,
    references,
)
from stub_model import STUB

from modelica_fmu.package import CSRC, _config
from modelica_fmu.toolchain import fmi_headers

Y_REF, F_REF, ONE = references(Y), references(FORCE), (c_double * 1)(1.0)
TWO = (c_double * 2)(1.0, 0.0)


@pytest.fixture(params=["cs", "me"])
def kind(request):
    return request.param


# The tables of FMI 2.0.4, sections 3.2.3 and 4.2.4: phases of model exchange, of co-simulation (I
# instantiated, M initialization mode, E event, C continuous, S step, T terminated, X error), and
# arguments of a call that only the phase can make fail.
FMI2: dict[str, tuple[str, str, Any]] = {
    "SetDebugLogging": ("IMECTX", "IMSTX", lambda r: (1, 0, None)),
    "SetupExperiment": ("I", "I", lambda r: (0, 0.0, 0.0, 0, 0.0)),
    "ExitInitializationMode": ("M", "M", lambda r: ()),
    "Terminate": ("EC", "S", lambda r: ()),
    "Reset": ("IMECTX", "IMSTX", lambda r: ()),
    "GetReal": ("MECTX", "MSTX", lambda r: (Y_REF, 1, (c_double * 1)())),
    "GetInteger": ("MECTX", "MSTX", lambda r: (references(BOUNCES), 1, (c_int * 1)())),
    "GetBoolean": ("MECTX", "MSTX", lambda r: (references(ON), 1, (c_int * 1)())),
    "GetString": ("MECTX", "MSTX", lambda r: (None, 0, None)),
    "SetReal": ("IMEC", "IMS", lambda r: (F_REF, 1, ONE)),
    "SetInteger": ("IME", "IMS", lambda r: (references(COUNT), 1, (c_int * 1)(2))),
    "SetBoolean": ("IME", "IMS", lambda r: (references(ON), 1, (c_int * 1)(1))),
    "SetString": ("IME", "IMS", lambda r: (None, 0, None)),
    "GetFMUstate": ("IMECTX", "IMSTX", lambda r: (byref(c_void_p()),)),
    "SetFMUstate": ("IMECTX", "IMSTX", lambda r: (r.start,)),
    "FreeFMUstate": ("IMECTX", "IMSTX", lambda r: (byref(c_void_p()),)),
    "SerializedFMUstateSize": ("IMECTX", "IMSTX", lambda r: (r.start, byref(c_size_t()))),
    "SerializeFMUstate": (
        "IMECTX",
        "IMSTX",
        lambda r: (r.start, ctypes.create_string_buffer(9999), 9999),
    ),
    "DeSerializeFMUstate": (
        "IMECTX",
        "IMSTX",
        lambda r: (r.bytes, len(r.bytes), byref(c_void_p())),
    ),
    "GetDirectionalDerivative": (
        "MECTX",
        "MSTX",
        lambda r: (Y_REF, 1, F_REF, 1, ONE, (c_double * 1)()),
    ),
    "EnterEventMode": ("EC", "", lambda r: ()),
    "NewDiscreteStates": ("E", "", lambda r: (byref((c_int * 16)()),)),
    "CompletedIntegratorStep": ("C", "", lambda r: (1, byref(c_int()), byref(c_int()))),
    "SetTime": ("EC", "", lambda r: (0.0,)),
    "SetContinuousStates": ("C", "", lambda r: (TWO, 2)),
    "GetDerivatives": ("MECTX", "", lambda r: ((c_double * 2)(), 2)),
    "GetEventIndicators": ("MECTX", "", lambda r: ((c_double * 1)(), 1)),
    "GetContinuousStates": ("MECTX", "", lambda r: ((c_double * 2)(), 2)),
    "GetNominalsOfContinuousStates": ("IMECTX", "", lambda r: ((c_double * 2)(), 2)),
    "SetRealInputDerivatives": ("", "IMS", lambda r: (None, 0, None, None)),
    "GetRealOutputDerivatives": ("", "STX", lambda r: (None, 0, None, None)),
    "DoStep": ("", "S", lambda r: (0.0, 1e-3, 1)),
    "CancelStep": ("", "", lambda r: ()),
    "GetStatus": ("", "ST", lambda r: (0, byref(c_int()))),
    "GetRealStatus": ("", "ST", lambda r: (2, byref(c_double()))),
    "GetBooleanStatus": ("", "ST", lambda r: (3, byref(c_int()))),
}


def _get(reference: int, ctype: Any) -> Any:
    return lambda r: (references(reference), 1, (ctype * 1)(), 1)


def _set(reference: int, ctype: Any, value: Any) -> Any:
    return lambda r: (references(reference), 1, (ctype * 1)(value), 1)


def _none(*tail: Any) -> Any:
    return lambda r: (None, 0, *tail)


# FMI 3.0, sections 2.3, 3.2 and 4.2. An error leads to Terminated.
FMI3: dict[str, tuple[str, str, Any]] = {
    "SetDebugLogging": ("IMECT", "IMST", lambda r: (True, 0, None)),
    "ExitInitializationMode": ("M", "M", lambda r: ()),
    "EnterEventMode": ("C", "", lambda r: ()),
    "Terminate": ("EC", "S", lambda r: ()),
    "Reset": ("IMECT", "IMST", lambda r: ()),
    "GetFloat64": ("IMECT", "IMST", _get(Y, c_double)),
    "GetInt32": ("IMECT", "IMST", _get(BOUNCES, c_int32)),
    "GetInt64": ("IMECT", "IMST", _get(MEDIUM, c_int64)),
    "GetBoolean": ("IMECT", "IMST", _get(ON, c_bool)),
    **{
        f"Get{t}": ("IMECT", "IMST", _none(None, 0))
        for t in ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "UInt64", "String")
    },
    "GetBinary": ("IMECT", "IMST", _none(None, None, 0)),
    "SetFloat64": ("IMEC", "IMS", _set(FORCE, c_double, 1.0)),
    "SetFloat32": ("IMEC", "IMS", _none(None, 0)),
    "SetInt32": ("IME", "IMS", _set(COUNT, c_int32, 2)),
    "SetInt64": ("IME", "IMS", _none(None, 0)),
    "SetBoolean": ("IME", "IMS", _set(ON, c_bool, True)),
    **{
        f"Set{t}": ("IME", "IMS", _none(None, 0))
        for t in ("Int8", "UInt8", "Int16", "UInt16", "UInt32", "UInt64", "String")
    },
    "SetBinary": ("IME", "IMS", _none(None, None, 0)),
    "GetClock": ("ME", "M", _none(None)),
    "SetClock": ("ME", "M", _none(None)),
    "GetNumberOfVariableDependencies": ("", "", lambda r: (Y, byref(c_size_t()))),
    "GetVariableDependencies": ("", "", lambda r: (Y, None, None, None, None, 0)),
    "GetFMUState": ("IMECT", "IMST", lambda r: (byref(c_void_p()),)),
    "SetFMUState": ("IMECT", "IMST", lambda r: (r.start,)),
    "FreeFMUState": ("IMECT", "IMST", lambda r: (byref(c_void_p()),)),
    "SerializedFMUStateSize": ("IMECT", "IMST", lambda r: (r.start, byref(c_size_t()))),
    "SerializeFMUState": ("IMECT", "IMST", lambda r: (r.start, (c_uint8 * 9999)(), 9999)),
    "DeserializeFMUState": ("IMECT", "IMST", lambda r: (r.bytes, len(r.bytes), byref(c_void_p()))),
    "GetDirectionalDerivative": (
        "MECT",
        "MST",
        lambda r: (Y_REF, 1, F_REF, 1, ONE, 1, (c_double * 1)(), 1),
    ),
    "GetAdjointDerivative": (
        "MECT",
        "MST",
        lambda r: (Y_REF, 1, F_REF, 1, ONE, 1, (c_double * 1)(), 1),
    ),
    "EnterConfigurationMode": ("", "", lambda r: ()),
    "ExitConfigurationMode": ("", "", lambda r: ()),
    "GetIntervalDecimal": ("ME", "M", _none(None, None)),
    "GetIntervalFraction": ("ME", "M", _none(None, None, None)),
    "GetShiftDecimal": ("ME", "M", _none(None)),
    "GetShiftFraction": ("ME", "M", _none(None, None)),
    "SetIntervalDecimal": ("ME", "M", _none(None)),
    "SetIntervalFraction": ("ME", "M", _none(None, None)),
    "SetShiftDecimal": ("ME", "M", _none(None)),
    "SetShiftFraction": ("ME", "M", _none(None, None)),
    "EvaluateDiscreteStates": ("E", "", lambda r: ()),
    "UpdateDiscreteStates": (
        "E",
        "",
        lambda r: (*(byref(c_bool()) for _ in range(5)), byref(c_double())),
    ),
    "CompletedIntegratorStep": ("C", "", lambda r: (True, byref(c_bool()), byref(c_bool()))),
    "SetTime": ("C", "", lambda r: (0.0,)),
    "SetContinuousStates": ("C", "", lambda r: (TWO, 2)),
    "GetContinuousStateDerivatives": ("MECT", "", lambda r: ((c_double * 2)(), 2)),
    "GetEventIndicators": ("MECT", "", lambda r: ((c_double * 1)(), 1)),
    "GetContinuousStates": ("MECT", "", lambda r: ((c_double * 2)(), 2)),
    "GetNominalsOfContinuousStates": ("MECT", "", lambda r: ((c_double * 2)(), 2)),
    "GetNumberOfEventIndicators": ("IMECT", "", lambda r: (byref(c_size_t()),)),
    "GetNumberOfContinuousStates": ("IMECT", "", lambda r: (byref(c_size_t()),)),
    "EnterStepMode": ("", "", lambda r: ()),
    "GetOutputDerivatives": ("", "ST", _none(None, None, 0)),
    "DoStep": (
        "",
        "S",
        lambda r: (
            0.0,
            1e-3,
            True,
            byref(c_bool()),
            byref(c_bool()),
            byref(c_bool()),
            byref(c_double()),
        ),
    ),
    "ActivateModelPartition": ("", "", lambda r: (0, 0.0)),
}
CALLS = [(fmi, word) for fmi, table in (("2.0", FMI2), ("3.0", FMI3)) for word in table]


@pytest.mark.parametrize(("version", "word"), CALLS, ids=[f"{v}-{w}" for v, w in CALLS])
def test_a_call_is_legal_in_the_phases_of_the_standard_and_nowhere_else(version, word, kind):
    exchange, cosimulation, arguments = {"2.0": FMI2, "3.0": FMI3}[version][word]
    legal = exchange if kind == "me" else cosimulation
    for phase in (
        ("IMECTX" if kind == "me" else "IMSTX")
        if version == "2.0"
        else "IMECT"
        if kind == "me"
        else "IMST"
    ):
        raw = Raw(version, kind)
        raw.start = raw.saved()
        raw.bytes = serialised(raw, raw.start)
        raw.go(phase)
        status = raw.call(word, *arguments(raw))
        assert (status == OK) == (phase in legal), (phase, raw.messages)
        if phase not in legal:
            assert status == ERROR
            function = f"fmi{version[0]}{word}"
            assert any(
                s == ERROR and c == "logStatusError" and function in text
                for s, c, text in raw.messages
            )
        raw.free()


def test_the_tables_hold_every_function(fmi):
    header = (fmi_headers() / f"fmi{fmi[0]}Functions.h").read_text()
    words = set(re.findall(rf"#define fmi{fmi[0]}([A-Z]\w+)\s+fmi", header))
    elsewhere = {
        "GetVersion",
        "GetTypesPlatform",
        "FreeInstance",
        "EnterInitializationMode",
        "EnterContinuousTimeMode",
    }
    elsewhere |= {"GetIntegerStatus", "GetStringStatus"}
    instantiate = {word for word in words if word.startswith("Instantiate")}
    assert words - elsewhere - instantiate == set(FMI2 if fmi == "2.0" else FMI3)


def serialised(raw: Raw, state: c_void_p) -> Any:
    word, ctype = ("FMUstate", ctypes.c_char) if raw.fmi == "2.0" else ("FMUState", c_uint8)
    size = c_size_t()
    assert raw.call(f"Serialized{word}Size", state, byref(size)) == OK
    buffer = (ctype * size.value)()
    assert raw.call(f"Serialize{word}", state, buffer, size.value) == OK
    return buffer


def deserialise(raw: Raw, data: Any) -> tuple[int, c_void_p]:
    state = c_void_p()
    word = "DeSerializeFMUstate" if raw.fmi == "2.0" else "DeserializeFMUState"
    return raw.call(word, data, len(data), byref(state)), state


def load(raw: Raw, state: c_void_p) -> int:
    return raw.call("SetFMUstate" if raw.fmi == "2.0" else "SetFMUState", state)


# ---- instantiation, logging ----


def test_version_and_platform():
    two, three = Raw("2.0", "cs"), Raw("3.0", "cs")
    assert two.dll.fmi2GetVersion() == b"2.0"
    assert two.dll.fmi2GetTypesPlatform() == b"default"
    assert three.dll.fmi3GetVersion() == b"3.0"


@pytest.mark.parametrize("logging", [True, False])
def test_a_wrong_token_or_name_is_no_instance_and_says_why(fmi, kind, logging):
    wrong = Raw(fmi, kind, token="{other}", logging=logging)
    assert not wrong.component
    assert "token {other} does not match" in wrong.messages[0][2]
    nameless = Raw(fmi, kind, name=" ", logging=logging)
    assert not nameless.component
    assert "the instance name is empty" in nameless.messages[0][2]


def test_fmi3_refuses_event_mode_intermediate_variables_and_scheduled_execution():
    raw = Raw("3.0", "cs")
    token, dll = raw.file.description.token.encode(), raw.dll
    update = dll.fmi3InstantiateCoSimulation.argtypes[-1]()
    head, tail = (b"it", token, None, False, True), (None, raw.logger, update)
    assert not dll.fmi3InstantiateCoSimulation(*head, True, False, None, 0, *tail)
    assert not dll.fmi3InstantiateCoSimulation(*head, False, False, references(Y), 1, *tail)
    assert dll.fmi3InstantiateCoSimulation(*head, False, True, None, 0, *tail)
    scheduled = dll.fmi3InstantiateScheduledExecution
    callbacks = [ctype() for ctype in scheduled.argtypes[-3:]]
    assert not scheduled(b"it", token, None, False, True, None, raw.logger, *callbacks)
    assert [text.partition(": ")[2][:20] for _, _, text in raw.messages] == [
        "eventModeUsed is tru",
        "intermediate variabl",
        "this FMU has no sche",
    ]


def test_log_categories_choose_what_is_said(fmi):
    raw = Raw(fmi, "cs").go("S")
    names = (ctypes.c_char_p * 1)(b"logStatusDiscard")
    assert raw.call("SetDebugLogging", False, 0, None) == OK
    assert raw.call("SetDebugLogging", True, 1, names) == OK
    assert raw.step(0.0, 1.0) == OK  # bounces: an event, not chosen
    assert raw.messages == []
    assert raw.set(FORCE, 99.0) == DISCARD
    assert [(status, category) for status, category, _ in raw.messages] == [
        (DISCARD, "logStatusDiscard")
    ]
    assert raw.call("SetDebugLogging", True, 1, (ctypes.c_char_p * 1)(b"logAnything")) == ERROR


def test_events_are_said_when_logging_is_on(fmi):
    raw = Raw(fmi, "cs").go("S")
    raw.step(0.0, 1.0)
    assert (0, "logEvents", "ball hits the floor") in raw.messages


def test_without_logging_fmi2_says_errors_and_fmi3_nothing(fmi):
    raw = Raw(fmi, "cs", logging=False).go("S")
    raw.step(0.0, 1.0)
    raw.set(FORCE, 99.0)
    raw.get(10**6)
    assert [category for _, category, _ in raw.messages] == (
        ["logStatusError"] if fmi == "2.0" else []
    )


# ---- variables ----


def test_a_value_out_of_bounds_is_discarded_and_changes_nothing(fmi, kind):
    raw = Raw(fmi, kind)
    extra = () if fmi == "2.0" else (2,)
    word = "SetReal" if fmi == "2.0" else "SetFloat64"
    for bad in (50.1, float("nan"), float("inf")):
        assert (
            raw.call(word, references(DRAG, FORCE), 2, (c_double * 2)(3.0, bad), *extra) == DISCARD
        )
        assert "f = " in raw.messages[-1][2]
    raw.go("M")
    assert raw.get(DRAG) == (OK, 0.5)
    assert raw.get(FORCE) == (OK, 0.0)


def test_a_type_mismatch_is_an_error(fmi, kind):
    real, integer = ("Real", "Integer") if fmi == "2.0" else ("Float64", "Int32")
    for word, ctype, reference in (
        (real, c_double, COUNT),
        (integer, c_int32, DRAG),
        ("Boolean", c_bool, MASS),
    ):
        ctype = c_int if ctype is c_bool and fmi == "2.0" else ctype
        raw = Raw(fmi, kind)
        assert raw.set(reference, 1, f"Set{word}", ctype) == ERROR
        assert "is of type" in raw.messages[-1][2]


def test_enumerations_are_integers_in_fmi2_and_int64_in_fmi3():
    two, three = Raw("2.0", "cs"), Raw("3.0", "cs")
    assert two.set(MEDIUM, 1, "SetInteger", c_int) == OK
    assert three.set(MEDIUM, 1, "SetInt64", c_int64) == OK
    assert three.set(MEDIUM, 1, "SetInt32", c_int32) == ERROR


def test_unknown_references_and_null_pointers_are_errors(fmi, kind):
    word = "GetReal" if fmi == "2.0" else "GetFloat64"
    extra = () if fmi == "2.0" else (1,)
    assert Raw(fmi, kind).go("M").get(17 if fmi == "2.0" else 18)[0] == ERROR
    assert Raw(fmi, kind).go("M").call(word, None, 1, (c_double * 1)(), *extra) == ERROR
    assert Raw(fmi, kind).go("M").call(word, Y_REF, 1, None, *extra) == ERROR
    assert Raw(fmi, kind).go("M").call(word, None, 0, None, *((0,) if extra else ())) == OK
    assert getattr(Raw(fmi, kind).dll, f"fmi{fmi[0]}Reset")(None) == ERROR


def test_fmi3_refuses_a_wrong_number_of_values():
    raw = Raw("3.0", "cs")
    assert raw.call("GetFloat64", Y_REF, 1, (c_double * 2)(), 2) == ERROR
    assert "2 values given, 1 expected" in raw.messages[-1][2]


def test_what_may_be_set_depends_on_the_phase(fmi):
    settable = {
        "I": {MASS, DRAG, FORCE, H},
        "M": {MASS, DRAG, FORCE, H},
        "S": {DRAG, FORCE},
        "E": {DRAG, FORCE},
        "C": {FORCE, H, V},
        "T": set(),
    }
    for phase, references_ in settable.items():
        for reference in (TIME, MASS, DRAG, WEIGHT, FORCE, H, V, DER_V, Y):
            if (reference, phase) in ((V, "I"), (V, "M")):
                continue  # as H
            raw = Raw(fmi, "cs" if phase == "S" else "me").go(phase)
            assert (raw.set(reference, 1.0) == OK) == (reference in references_), (phase, reference)


def test_initialization_mode_follows_every_set(fmi, kind):
    raw = Raw(fmi, kind).go("M")
    assert raw.get(WEIGHT) == (OK, 9.81)
    assert raw.set(MASS, 2.0) == OK  # a fixed parameter, after results have been read
    assert raw.get(WEIGHT) == (OK, 19.62)
    assert raw.set(H, 3.0) == OK
    assert raw.get(Y) == (OK, 3.0)
    assert raw.call("ExitInitializationMode") == OK
    assert raw.get(H) == (OK, 3.0)
    assert raw.get(MASS) == (OK, 2.0)


def test_a_start_the_model_refuses_is_an_error_with_its_message(fmi, kind):
    raw = Raw(fmi, kind)
    assert raw.set(H, -1.0) == OK
    assert raw.setup() == OK
    assert raw.call("ExitInitializationMode") == ERROR
    assert raw.messages[-1] == (ERROR, "logStatusError", "ball.h must be >= 0 at the start")


def test_fmi3_event_indicators_are_variables():
    raw = Raw("3.0", "me").go("C")
    indicator = (c_double * 1)()
    assert raw.call("GetEventIndicators", indicator, 1) == OK
    assert raw.get(17) == (OK, indicator[0]) == (OK, 1.0)


# ---- co-simulation ----


def test_steps_of_any_size_reach_their_end(fmi):
    raw = Raw(fmi, "cs")
    raw.setup(start=5.0)
    raw.call("ExitInitializationMode")
    time = 5.0
    for step in (1e-3, 0.25, 1e-6, 0.1):
        assert raw.step(time, step) == OK
        time += step
        assert raw.get(TIME) == (OK, time)
    if fmi == "3.0":
        assert raw.last.value == time


@pytest.mark.parametrize(
    ("time", "step", "message"),
    [
        (0.0, 0.0, "step size"),
        (0.0, -1e-3, "step size"),
        (0.0, float("nan"), "step size"),
        (0.0, float("inf"), "step size"),
        (1e-6, 1e-3, "communication point"),
        (float("nan"), 1e-3, "communication point"),
        (0.0, 2.1, "stop time"),
    ],
)
def test_a_step_that_cannot_be_taken_is_an_error(fmi, time, step, message):
    raw = Raw(fmi, "cs")
    raw.setup(stop=2.0)
    raw.call("ExitInitializationMode")
    assert raw.step(time, step) == ERROR
    assert message in raw.messages[-1][2]
    assert raw.step(0.0, 1e-3) == ERROR  # only a reset or an FMU state leads out


def test_rounding_of_the_masters_time_is_accepted(fmi):
    raw = Raw(fmi, "cs")
    raw.setup(stop=0.3)
    raw.call("ExitInitializationMode")
    for k in range(3):
        assert raw.step(k * 0.1, 0.1) == OK  # 0.1 + 0.1 + 0.1 > 0.3


def test_setup_of_the_experiment_is_checked(fmi):
    assert Raw(fmi, "cs").setup(start=float("nan")) == ERROR
    assert Raw(fmi, "cs").setup(start=1.0, stop=0.5) == ERROR
    if fmi == "2.0":
        raw = Raw(fmi, "cs")
        assert raw.call("EnterInitializationMode") == ERROR
        assert "call fmi2SetupExperiment first" in raw.messages[-1][2]


def test_fmi2_status_of_the_last_step():
    raw = Raw("2.0", "cs").go("S")
    raw.step(0.0, 0.5)
    status, time, terminated = c_int(9), c_double(), c_int(9)
    assert (
        raw.call("GetStatus", 0, byref(status)) == raw.call("GetRealStatus", 2, byref(time)) == OK
    )
    assert raw.call("GetBooleanStatus", 3, byref(terminated)) == OK
    assert (status.value, time.value, terminated.value) == (OK, 0.5, 0)
    assert raw.call("GetIntegerStatus", 0, byref(c_int())) == DISCARD
    assert raw.call("GetStringStatus", 1, byref(ctypes.c_char_p())) == DISCARD


def test_absent_features_are_errors_when_asked_for():
    two, three = Raw("2.0", "cs").go("S"), Raw("3.0", "cs").go("S")
    state = two.saved()
    for word in ("SetRealInputDerivatives", "GetRealOutputDerivatives"):
        assert two.call(word, Y_REF, 1, (c_int * 1)(1), (c_double * 1)()) == ERROR
        assert load(two, state) == OK
    assert two.call("GetString", Y_REF, 1, (ctypes.c_char_p * 1)()) == ERROR
    assert (
        three.call("GetOutputDerivatives", Y_REF, 1, (c_int32 * 1)(1), (c_double * 1)(), 1) == ERROR
    )
    assert "no output derivatives" in three.messages[-1][2]
    three = Raw("3.0", "cs").go("S")
    assert three.call("GetUInt8", Y_REF, 1, (c_uint8 * 1)(), 1) == ERROR
    assert "no UInt8 variables" in three.messages[-1][2]


# ---- model exchange ----


def test_continuous_time_mode_needs_an_event_iteration_first(fmi):
    raw = Raw(fmi, "me").go("E")
    assert raw.call("EnterContinuousTimeMode") == ERROR
    assert "until" in raw.messages[-1][2]


def test_vectors_have_the_models_length(fmi):
    for word, n in (
        ("GetContinuousStates", 3),
        ("SetContinuousStates", 1),
        ("GetEventIndicators", 0),
    ):
        raw = Raw(fmi, "me").go("C")
        assert raw.call(word, (c_double * max(n, 1))(), n) == ERROR
        assert f"{n} values given" in raw.messages[-1][2]


def test_nominals_are_those_of_the_description(fmi):
    values = (c_double * 2)()
    assert Raw(fmi, "me").go("M").call("GetNominalsOfContinuousStates", values, 2) == OK
    assert list(values) == [STUB.variables[s].nominal for s in STUB.states]


def test_a_bounce_by_the_importers_event_iteration(fmi):
    raw = Raw(fmi, "me").go("C")
    assert raw.call("SetTime", 0.5) == OK
    assert raw.call("SetContinuousStates", (c_double * 2)(-1e-9, -2.0), 2) == OK
    assert raw.call("EnterEventMode") == OK
    assert raw.update_discrete() == OK
    assert raw.get(V) == (OK, pytest.approx(1.4))
    assert raw.get(BOUNCES, "GetInteger" if fmi == "2.0" else "GetInt32", c_int32) == (OK, 1)


# ---- partial derivatives ----


def test_directional_derivatives(fmi, kind):
    raw = Raw(fmi, kind)
    raw.set(ON, 1, "SetBoolean", c_int if fmi == "2.0" else c_bool)
    raw.go("C" if kind == "me" else "S")
    unknowns, knowns, seed, out = (
        references(Y, A, DER_V),
        references(FORCE, V),
        (c_double * 2)(2.0, 4.0),
        (c_double * 3)(),
    )
    extra = ((3,), (2,)) if fmi == "3.0" else ((), ())
    assert (
        raw.call(
            "GetDirectionalDerivative", unknowns, 3, knowns, 2, seed, *extra[1], out, *extra[0]
        )
        == OK
    )
    assert list(out) == pytest.approx([0.02, 0.0, 0.0])
    if fmi == "3.0":
        seeds, sensitivity = (c_double * 3)(1.0, 2.0, 3.0), (c_double * 2)()
        assert (
            raw.call("GetAdjointDerivative", unknowns, 3, knowns, 2, seeds, 3, sensitivity, 2) == OK
        )
        assert list(sensitivity) == pytest.approx([0.01 + 2.0 + 3.0, -0.5 * (2.0 + 3.0)])


# ---- FMU states ----


def test_a_loaded_state_replays_bit_for_bit(fmi):
    raw = Raw(fmi, "cs").go("S")
    raw.step(0.0, 0.4)
    state = raw.saved()
    raw.set(FORCE, 5.0)
    raw.step(0.4, 0.4)
    first = raw.get(H), raw.get(V)
    for _ in range(2):
        assert load(raw, state) == OK
        assert raw.get(FORCE) == (OK, 0.0)
        raw.set(FORCE, 5.0)
        assert raw.step(0.4, 0.4) == OK
        assert (raw.get(H), raw.get(V)) == first


def test_a_state_brings_its_phase_with_it(fmi, kind):
    raw = Raw(fmi, kind).go("M")
    assert raw.get(WEIGHT) == (OK, 9.81)  # initialised, and yet open for sets
    state = raw.saved()
    raw.call("ExitInitializationMode")
    assert raw.call("Terminate") == OK
    assert load(raw, state) == OK
    assert raw.set(MASS, 2.0) == OK
    assert raw.get(WEIGHT) == (OK, 19.62)
    assert raw.call("ExitInitializationMode") == OK
    raw.get(10**6)  # an error
    assert load(raw, state) == OK
    assert raw.call("ExitInitializationMode") == OK


def test_a_serialised_state_works_in_another_instance(fmi):
    raw, other = Raw(fmi, "cs").go("S"), Raw(fmi, "cs")
    raw.step(0.0, 0.7)
    data = serialised(raw, raw.saved())
    status, state = deserialise(other, data)
    assert status == OK
    assert load(other, state) == OK
    assert raw.step(0.7, 0.7) == other.step(0.7, 0.7) == OK
    assert raw.get(H) == other.get(H)
    assert bytes(serialised(raw, raw.saved())) == bytes(serialised(other, other.saved()))


def test_damaged_foreign_and_truncated_states_are_errors(fmi):
    raw = Raw(fmi, "cs").go("S")
    state = raw.saved()
    data = serialised(raw, state)
    for k in (0, 10, 20, 30, 50, 70, 100, len(data) - 1):
        damaged = type(data).from_buffer_copy(data)
        damaged[k] = (bytes(data)[k] ^ 1) if fmi == "3.0" else bytes([bytes(data)[k] ^ 1])
        assert deserialise(raw, damaged)[0] == ERROR, k
        assert load(raw, state) == OK
    for n in (0, 1, 40, len(data) - 1):
        assert deserialise(raw, bytes(data)[:n])[0] == ERROR
        assert load(raw, state) == OK
    exchange = Raw(fmi, "me")
    assert load(exchange, state) == ERROR
    assert "co-simulation instance" in exchange.messages[-1][2]
    assert load(Raw(fmi, "cs"), c_void_p()) == ERROR


def test_saving_reuses_memory_and_freeing_clears_the_pointer(fmi):
    raw = Raw(fmi, "cs").go("S")
    word = "FMUstate" if fmi == "2.0" else "FMUState"
    state = raw.saved()
    address = state.value
    raw.step(0.0, 0.1)
    assert raw.call(f"Get{word}", byref(state)) == OK
    assert state.value == address
    assert raw.call(f"Free{word}", byref(state)) == OK
    assert state.value is None
    assert raw.call(f"Free{word}", byref(state)) == OK


# ---- instances ----


def test_two_instances_do_not_know_each_other(fmi):
    one, two = Raw(fmi, "cs"), Raw(fmi, "cs")
    one.set(MASS, 5.0)
    one.go("S")
    two.go("S")
    for k in range(100):
        one.step(k * 0.01, 0.01)
        if k % 2:
            two.step((k - 1) * 0.01, 0.02)
    alone = Raw(fmi, "cs").go("S")
    for k in range(50):
        alone.step(k * 0.02, 0.02)
    assert two.get(H) == alone.get(H)
    assert one.get(H) != two.get(H)
    assert two.get(MASS) == (OK, 1.0)


def test_reset_is_a_fresh_instance(fmi):
    raw, fresh = Raw(fmi, "cs").go("S"), Raw(fmi, "cs").go("S")
    raw.set(DRAG, 3.0)
    raw.step(0.0, 0.5)
    assert raw.call("Reset") == OK
    raw.go("S")
    assert raw.step(0.0, 0.5) == fresh.step(0.0, 0.5) == OK
    assert raw.get(H) == fresh.get(H)


def test_ten_thousand_instances_leave_no_memory_behind(fmi, kind):
    def cycle(n: int) -> None:
        for _ in range(n):
            raw = Raw(fmi, kind)
            raw.go("S")
            state = raw.saved()
            raw.call("FreeFMUstate" if fmi == "2.0" else "FreeFMUState", byref(state))
            raw.free()

    cycle(500)
    gc.collect()
    before = resident()
    cycle(10_000)
    gc.collect()
    assert (
        resident() - before < 3_000_000
    )  # an instance and its saved state have over 800 bytes: 8 MB if they stayed


def resident() -> int:
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    except OSError:
        pytest.skip("resident memory is read from /proc")


# ---- the C code itself ----

CC = shutil.which("cc")
DRIVER = Path(__file__).parent / "stub"


def compile_c(folder: Path, fmi: str, *flags: str) -> subprocess.CompletedProcess[str]:
    """The wrapper, the stub and, for a program, the driver of this FMI version."""
    n = fmi[0]
    for path in (
        CSRC / "core.h",
        CSRC / "wrapper.h",
        CSRC / "wrapper.c",
        CSRC / f"fmi{n}.c",
        DRIVER / f"drive{n}.c",
    ):
        shutil.copy(path, folder)
    for name, text in STUB.sources.items():
        (folder / name).write_text(text)
    (folder / "fmu_config.h").write_text(_config(STUB, "{token}"))
    files = ["wrapper.c", f"fmi{n}.c", *STUB.sources]
    command = [str(CC), "-std=c11", "-isystem", str(fmi_headers()), "-I.", *flags, *files, "-lm"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.skipif(not CC, reason="no C compiler")
@pytest.mark.parametrize(
    "warnings", ["-Wall -Wextra -pedantic", "-Wconversion -Wshadow -Wstrict-prototypes -Wvla"]
)
def test_the_c_code_compiles_without_warnings(fmi, warnings, tmp_path):
    result = compile_c(tmp_path, fmi, *warnings.split(), "-O2", "-fPIC", "-shared", "-o", "it.so")
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.skipif(not CC, reason="no C compiler")
def test_a_function_prefix_names_the_functions_of_a_source_fmu(tmp_path):
    result = compile_c(tmp_path, "3.0", "-DFMI3_FUNCTION_PREFIX=Stub_", "-c")
    assert result.returncode == 0, result.stderr
    symbols = subprocess.run(
        ["nm", "--defined-only", "fmi3.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "Stub_fmi3DoStep" in symbols.stdout


@pytest.mark.skipif(not CC, reason="no C compiler")
def test_all_calls_in_all_orders_are_clean_under_the_sanitizers(fmi, tmp_path):
    flags = [
        "-g",
        "-O1",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
        f"drive{fmi[0]}.c",
        "-o",
        "drive",
    ]
    result = compile_c(tmp_path, fmi, *flags)
    if "cannot find" in result.stderr:
        pytest.skip("no sanitizer libraries")
    assert result.returncode == 0, result.stderr
    run = subprocess.run(["./drive"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[-3000:]
    assert "calls" in run.stdout
