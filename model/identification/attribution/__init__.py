"""Attribution: which cause outside the model explains the misfit of a joint fit."""
