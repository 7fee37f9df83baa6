/* A ball thrown up by an input force, falling back onto the floor: the smallest model with a variable of every kind and type. */
#include <float.h>
#include <math.h>

#include "core.h"

const char model_name[] = "Stub.Ball";
const ModelVariable model_variables[] = {
    {"time", VK_TIME, VT_REAL, SET_NEVER, 0, -INFINITY, INFINITY},
    {"m", VK_PARAMETER, VT_REAL, SET_BEFORE_START, 0, 0.1, 100.0},
    {"g", VK_PARAMETER, VT_REAL, SET_BEFORE_START, 1, -INFINITY, INFINITY},
    {"k", VK_PARAMETER, VT_REAL, SET_ALWAYS, 2, 0.0, 10.0},
    {"e", VK_PARAMETER, VT_REAL, SET_ALWAYS, 3, 0.0, 1.0},
    {"medium", VK_PARAMETER, VT_ENUMERATION, SET_BEFORE_START, 4, 1, 2},
    {"n", VK_PARAMETER, VT_INTEGER, SET_ALWAYS, 5, 1, 3},
    {"weight", VK_CALCULATED, VT_REAL, SET_NEVER, 6, -INFINITY, INFINITY},
    {"f", VK_INPUT, VT_REAL, SET_ALWAYS, 0, -50.0, 50.0},
    {"on", VK_INPUT, VT_BOOLEAN, SET_ALWAYS, 1, 0, 1},
    {"ball.h", VK_STATE, VT_REAL, SET_BEFORE_START, 0, -INFINITY, INFINITY},
    {"ball.v", VK_STATE, VT_REAL, SET_BEFORE_START, 1, -INFINITY, INFINITY},
    {"der(ball.h)", VK_DERIVATIVE, VT_REAL, SET_NEVER, 0, -INFINITY, INFINITY},
    {"der(ball.v)", VK_DERIVATIVE, VT_REAL, SET_NEVER, 1, -INFINITY, INFINITY},
    {"y", VK_ALGEBRAIC, VT_REAL, SET_NEVER, 0, -INFINITY, INFINITY},
    {"a", VK_ALGEBRAIC, VT_REAL, SET_NEVER, 1, -INFINITY, INFINITY},
    {"bounces", VK_DISCRETE, VT_INTEGER, SET_NEVER, 0, 0, 1e9},
};
const size_t model_n_variables = sizeof model_variables / sizeof model_variables[0];
const size_t model_n_states = 2, model_n_indicators = 1;
const unsigned model_state_references[] = {10, 11}, model_derivative_references[] = {12, 13};
