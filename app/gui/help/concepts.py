"""Concepts of the help (F1): safety first, then the terms of the window, and how-tos."""

CONCEPTS = {
    "Safety": {
        "0 V is not safe": "0 V at the amplifier's input is −500 V on the specimen. A cable that is off, or a generator without mains, is 0 V.",
        "Rest": "2.5 V at the amplifier's input: 0 V on the specimen. Every run begins and ends there, and the card measures it.",
        "Armed": "The source is at rest, rest was measured, and you have switched the high voltage on. Nothing is driven yet.",
        "LIVE": "There is high voltage on the specimen: do not touch it. Esc or F12 ramps to rest from any page.",
        "AT REST": "Rest was measured after the drive. The high voltage is still on until you switch it off at the amplifier.",
        "UNSAFE": "Rest could not be confirmed. Switch the high voltage off at the amplifier by hand, as the message says; then F4.",
        "Drive limits": "Range, slope and step at the amplifier's input. A drive beyond them is refused before anything moves, never clipped.",
        "Watchdog": "A second process that brings the source to rest if this program dies or hangs while the bench is live.",
        "Commissioning": "Properties that the driver assumes of your source, measured with high voltage off. A real bench does not arm without it.",
    },
    "Words": {
        "Protocol, run": "A protocol is the procedure of a measurement; a run is one execution of it, stored in one file with all samples.",
        "Sine dwell": "One frequency at a time, held until the response is steady; whole cycles are recorded.",
        "Peak-to-peak displacement": "Largest less smallest displacement in a cycle; twice the amplitude of a pure sine.",
        "Membrane sag": "How far the membrane hangs under the tactor's weight, against a reference of known depth: its pre-stretch.",
        "Verdict": "GOOD, DOUBTFUL, DID NOT PASS or NO RESULT: whether the measurement can be used, not whether the program ended.",
        "Not usable": "A point that no fit uses, drawn hollow, with the reason beside it: clipped, drive off, unsettled.",
        "Statistical, total uncertainty": "Scatter alone, and everything: gain of the sensor, clamping, dimensions by ruler.",
        "Campaign": "All measurements of one specimen, each after those it needs; a result counts when you accept it.",
        "Simulated": "No instrument was connected. Simulated data are marked wherever they appear, and never count for a real campaign.",
        "Virtual clock": "Speed 'max' of the simulated bench: time passes only by work, so that a minute takes a second.",
    },
    "How to": {
        "Learn the window": "Help, Tutorial: ten minutes on the simulated bench.",
        "Set up a bench": "Help, Tutorial: set up my own bench; or the page Bench, Ctrl+5.",
        "Check the wiring": "Page Bench, Ctrl+5: small voltages show polarity, gain, latency and noise before the first run.",
        "Practise prompts and faults": "F9: who answers prompts, the speed of the simulated bench, and a list of faults.",
        "Continue a stopped run": "Continue on the result card, or Ctrl+4, select it, Ctrl+Enter: the measured points are kept.",
        "Compare many specimens": "Page Laboratory, Ctrl+6: values with limits, control charts, certificates, audit trail.",
        "Identify the parameters": "Ctrl+4, select runs, E, then Ctrl+F on the page Explore.",
        "Give results to others": "Ctrl+4, select runs, Ctrl+E: tables, MATLAB, and more; a campaign has a report.",
    },
}
"""Explanation of each word or question, by group in the order of the help."""
