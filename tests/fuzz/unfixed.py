"""Errors outside the tree that are known and not fixed yet, by target.

Who fixes one takes it from here: the tests of the kept inputs fail as long as it is still listed.
"""

from target import PropertyBrokenError

UNFIXED = {
    "fuji-decoder": (PropertyBrokenError,),  # decodes an ACK with 01H among its fill characters; the framer does not
}
