"""The sets that `pneugantry blind --set` draws, in words. Imports nothing: help asks for them."""

__all__ = ["SETS"]

SETS = {
    "plain": "parameters 2 % off, all else exact",
    "nuisance": "a little off everywhere, as measured rigs are: offsets, scales, stand-off, noise",
    "three": "the same with three effects",
    "nofa": "the same without actuator force sensors",
    "contour": "the same, contouring logs alone",
    "both": "the same with a known effect and an unknown one",
    "faint": "the same with effects of 0.4 times the usual size",
    "wide": "the same with parameters 5 % off",
    "unknown12": "twelve effects that no catalogue names, three sizes each, in turn",
    "both12": "a known effect and one of these twelve",
    "odd": "rigs on which one thing is off that earlier versions took for an effect",
    "random": "a random function of a random signal, in an input or a sensor",
}
