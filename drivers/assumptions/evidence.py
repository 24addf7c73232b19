"""Public drivers and guides that several assumptions cite."""

BENCHCTRL = "benchctrl at 0c6e51e (SDG1032X, firmware 1.01.01.33R1B6)"
PYMEASURE, QCODES, TM_DEVICES = "PyMeasure at 32503b8", "QCoDeS at 19fae2b", "tm_devices at db887dd"
MENLO = "Menlo Systems' DG1000Z driver"
DG1000Z_GUIDE = "DG1000Z Programming Guide"
DG2000_GUIDE = "DG2000 Programming Guide (PGB12000)"
EDU_GUIDE = "EDU33210 User's Guide (EDU33212-90002)"
