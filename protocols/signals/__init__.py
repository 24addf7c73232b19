"""From samples to numbers, one module per matter, all of them pure functions.

Arrays in physical units and a rate go in, frozen values with standard errors come out. What cannot be told from the
samples is refused with a sentence (ValueError).

    sine       fit_sine, fit_frequency                amplitude and phase of a sine with harmonics
    settling   SettlingDetector                       has the response to a sine become steady?
    response   FrequencyResponse, joined              a frequency response with coherence and error bars,
                                                      from a sweep (swept_response) or periods (periodic_response)
    peak       spectrum_peak, response_peak           where a spectrum, or a response, is largest
    mode       fit_mode                               natural frequency and damping from a response
    level      level, step_value                      a mean and a step, with errors that know mains and slow noise
    landing    LandingDetector                        a mass lands on the tactor, online
    creep      fit_creep                              logarithmic creep per decade
    loop       fold, measure_loops                    width, area, asymmetry of hysteresis loops
    decay      fit_decay                              frequency and damping of a free decay
    multisine  Multisine                              a periodic excitation with a small crest factor

`samples`, `lines`, `recorded_sweep` and `repeating` are what several of them share, or one needs. Only numpy is imported here; what needs scipy is imported from its module, by name.
"""

from protocols.signals.settling import SettlingDetector
from protocols.signals.sine import SineFit, fit_frequency, fit_sine

__all__ = ["SettlingDetector", "SineFit", "fit_frequency", "fit_sine"]
