"""All kinds of attack by name."""

from tests.attacks import controllers, disks, kills, parallel
from tests.attacks.trials import Attack

ATTACKS: dict[str, Attack] = {attack.name: attack for attack in (kills.KILL, kills.SIGNAL, disks.DISK, controllers.HOSTILE, parallel.PARALLEL)}
