"""How far an estimate may be off before it is called inconsistent: for its own verdict, and for the doubts about it."""

from __future__ import annotations

TOLERATED_VARIANCE_FACTOR = 2.0
"""Factor by which a variance may be wrong without a fault being reported. Chosen by hand; not fitted."""
TOLERATED_SIGMA_FACTOR = 2.0
"""Factor by which a sigma may be too large without being called larger than necessary. Chosen by hand: a sigma that is
1.4 times too large changes no decision, one that is too small does."""
MAX_GATED_ROW_SHARE = 0.05
"""Share of gated rows above which a source contradicts the others. Chosen by hand; not fitted."""
MAX_BRIDGED_STATE_SHARE = 0.2
"""Share of bridged states that is reported as a fault. Chosen by hand; not fitted."""
MAX_UNREPORTED_STATE_DELAY_S = 1.0
"""Delay of a state from which on it is reported, s; chosen by hand."""
MIN_LOG_SPAN_FOR_SLOW_ERRORS_S = 60.0
"""Least span of a log in which slow errors are searched, s. Chosen: a slow error has to come and go a few times."""
