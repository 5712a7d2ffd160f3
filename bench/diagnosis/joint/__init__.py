"""The diagnosis of one joint: from its recordings to a verdict (:mod:`.diagnosis`)."""
