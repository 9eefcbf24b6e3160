"""A route that is learnt from its drives: adapting a descriptor to it, without labels or with."""
