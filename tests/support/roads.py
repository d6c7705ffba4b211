"""Small roads for tests, built by netconvert, with single vehicles on them."""

import subprocess
from pathlib import Path

import sumo

SITE = (
    '<poi id="s0" x="100" y="20" type="isac_site"><param key="height" value="15"/>'
    '<param key="azimuth" value="180"/></poi>'
)


def straight_road(
    folder: Path,
    vehicles: str,
    sites: str = SITE,
    lanes: int = 3,
    shift: float = 0.0,
    ending: bool = False,
    lefthand: bool = False,
    additional: str = "",
    edge_m: float = 1500.0,
) -> Path:
    """Make a scenario: a straight road in two edges, 3 km long in all by default. Returns its folder.

    folder: gives the scenario its name, on which all random draws depend. pytest numbers the folders that it makes, in
    the order in which tests ask for them: give a folder inside such a one.
    vehicles, sites, additional: XML. shift: of the road's start from SUMO's origin, m, in x and y.
    ending: the right lane of the first edge ends there, and the second edge has one lane fewer.
    lefthand: traffic keeps left; the road is then the mirror image. edge_m: length of an edge, m.
    """
    folder.mkdir(parents=True, exist_ok=True)
    nodes = "".join(f'<node id="n{k}" x="{shift + edge_m * k}" y="{shift}"/>' for k in range(3))
    edges = "".join(
        f'<edge id="e{k}" from="n{k}" to="n{k + 1}" numLanes="{lanes - k * ending}" speed="36.11" width="3.6"/>'
        for k in range(2)
    )
    links = "".join(
        f'<connection from="e0" to="e1" fromLane="{k}" toLane="{k - ending}"/>' for k in range(int(ending), lanes)
    )
    (folder / "r.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "r.edg.xml").write_text(f"<edges>{edges}</edges>")
    (folder / "r.con.xml").write_text(f"<connections>{links}</connections>")
    subprocess.run(
        [
            Path(sumo.SUMO_HOME) / "bin" / "netconvert",
            "--node-files=r.nod.xml",
            "--edge-files=r.edg.xml",
            "--connection-files=r.con.xml",
            "--output-file=r.net.xml",
            "--offset.disable-normalization",
            "--no-turnarounds",
            *(["--lefthand"] if lefthand else []),
        ],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    car = (
        'carFollowModel="IDM" accel="2" decel="4" emergencyDecel="9" speedFactor="0.8" speedDev="0" '
        'latAlignment="center" lcKeepRight="0" lcSpeedGain="0"'
    )
    (folder / "r.rou.xml").write_text(
        f'<routes><vType id="car" {car}/><route id="all" edges="e0 e1"/>{vehicles}</routes>'
    )
    (folder / "sites.add.xml").write_text(f"<additional>{sites}{additional}</additional>")
    (folder / "r.sumocfg").write_text(
        '<configuration><input><net-file value="r.net.xml"/><route-files value="r.rou.xml"/>'
        '<additional-files value="sites.add.xml"/></input></configuration>'
    )
    return folder


def vehicle(name: str, depart: float = 0.0, lane: int = 1, position: float = 10.0, speed: float = 25.0) -> str:
    """Return a car as XML. depart: s. position: m. speed: m/s."""
    return (
        f'<vehicle id="{name}" type="car" route="all" depart="{depart}" departLane="{lane}" '
        f'departPos="{position}" departSpeed="{speed}"/>'
    )
