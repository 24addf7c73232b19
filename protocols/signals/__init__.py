"""Signal analysis: estimators from samples to numbers, all pure functions.

Arrays in physical units and a rate go in, frozen values with standard errors come out. Insufficient samples raise ValueError with
the reason.

    sine       fit_sine, fit_frequency                amplitude and phase of a sine with harmonics
    extremes   estimate_max_min                       max - min of a waveform without the bias of noise and sampling
    interference  find_lines, remove_lines            hum and other lines at rest, and recordings without them
    integration  displacement_under_sine              displacement from a vibrometer's velocity
    settling   SettlingDetector                       detection of a steady response to a sine
    response   FrequencyResponse                      a frequency response with coherence and error bars,
                                                      from a sweep (swept_response) or periods (periodic_response)
    peak       joined_spectrum_peak, dwell_peak,      maximum of a spectrum or response
               response_peak
    modal_fit  fit_sdof                               natural frequency and damping from a response
    held_level estimate_level, estimate_step,         a mean and a step, with errors that include mains and slow noise,
               fit_creep                              and logarithmic creep per decade
    step_detection  WeightStepDetector                a weight placed on the tactor, online
    loop       fold, measure_loops                    width, area, asymmetry of hysteresis loops
    onset      find_edge, first_crossings             crossing of a level after a step or a sine's onset
    decay      fit_decay                              frequency and damping of a free decay

`checks` and `spectral_blocks` are shared by several of them. Each name is imported when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
