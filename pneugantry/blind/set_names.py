"""The sets that `pneugantry blind --set` draws, in words. Imports nothing: help asks for them."""

__all__ = ["SETS"]

SETS = {
    "plain": "parameters 2 % off, all else exact",
    "nuisance": "a little off everywhere, as measured rigs are: offsets, scales, stand-off, noise",
    "three": "as nuisance, with three effects",
    "nofa": "as nuisance, without actuator force sensors",
    "contour": "as nuisance, contouring logs alone",
    "both": "as nuisance, with a known effect and an unknown one",
    "faint": "as nuisance, with effects of 0.4 times the usual size",
    "coarse": "as nuisance, with coarse converters, alone or beside another effect",
    "wide": "as nuisance, with parameters 5 % off",
    "unknown12": "twelve effects that no catalogue names, three sizes each, in turn",
    "both12": "a known effect and one of these twelve",
    "odd": "nine rigs that earlier versions answered wrongly, seeds 0 to 8",
    "random": "a random function of one or two signals, in a valve, friction, contact or a sensor",
}
