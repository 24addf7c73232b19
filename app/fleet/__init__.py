"""Many specimens over months: values with total uncertainty, capability, control charts, drift of bench or specimen."""
