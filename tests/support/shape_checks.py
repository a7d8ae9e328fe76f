"""The run-time checker behind the tests: every jaxtyping annotation of the three packages is enforced."""

from beartype import BeartypeConf, beartype

# An int where a float is expected is fine, as it is to a type checker.
enforce = beartype(conf=BeartypeConf(is_pep484_tower=True))
