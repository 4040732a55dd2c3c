"""All kinds of attack by name."""

from tests.attacks.controllers import CONTROLLERS
from tests.attacks.disks import DISKS
from tests.attacks.kills import KILLS, SIGNALS
from tests.attacks.parallel import PARALLEL
from tests.attacks.recordings import RECORDINGS
from tests.attacks.scenarios import SCENARIOS

ATTACKS = {attack.name: attack for attack in (KILLS, SIGNALS, DISKS, RECORDINGS, SCENARIOS, CONTROLLERS, PARALLEL)}
