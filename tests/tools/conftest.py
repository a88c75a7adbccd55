"""What the tests of several tools share."""

import pytest

from tools.campaign.engine import run_campaign
from tools.campaign.plan import Wanted

SHORT = Wanted("hyperion-1", "sensitivity", 6, 1, "lqy", ("end.time_max_s=10",))


@pytest.fixture(scope="session")
def short_campaign(tmp_path_factory):
    """Six flights of ten seconds, flown one after the other; nobody changes its folder."""
    return run_campaign(SHORT, tmp_path_factory.mktemp("campaign"), jobs=1)
