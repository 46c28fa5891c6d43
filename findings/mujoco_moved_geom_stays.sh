#!/usr/bin/env bash
# mujoco 4.0.0: a geom or site that is moved in a compiled model stays where it was, if it was
# written at its body's origin.
#
# Models are randomised and calibrated by writing into mjModel.geom_pos and site_pos, and two
# bodies here differ only in where the file has their geom and site: one at the body's origin,
# one 10 mm beside it. Both are moved to x = 0.5 m. One expects both to be there after
# mj_kinematics, or after mj_setConst, which recomputes what follows from changed fields.
# The second is. The first stays at the body's origin without a word: the compiler has noted
# in geom_sameframe and site_sameframe that frames coincide, and kinematics copies the body's
# pose as long as that note stands. Contacts and sensors use the old place.
# So a randomised offset of 0 mm in the file, the usual nominal value, is not randomised at all.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco

xml = """<mujoco><worldbody><body><freejoint/>
  <geom size=".1" pos="%s 0 0"/><geom size=".1" pos="-.2 .1 0"/><site pos="%s 0 0"/>
</body></worldbody></mujoco>"""
print("mujoco", mujoco.__version__)
for written in (0.0, 0.01):
    model = mujoco.MjModel.from_xml_string(xml % (written, written))
    data = mujoco.MjData(model)
    model.geom_pos[0] = model.site_pos[0] = [0.5, 0, 0]
    mujoco.mj_kinematics(model, data)
    geom, site = data.geom_xpos[0][0], data.site_xpos[0][0]
    print(f"written at {written} m, moved to 0.5 m: geom at {geom:.2f} m, site at {site:.2f} m")
    expected = 0.0 if written == 0.0 else 0.5
    assert abs(geom - expected) < 1e-9 and abs(site - expected) < 1e-9
    mujoco.mj_setConst(model, data)
    mujoco.mj_kinematics(model, data)
    geom, site = data.geom_xpos[0][0], data.site_xpos[0][0]
    print(f"    after mj_setConst: geom at {geom:.2f} m, site at {site:.2f} m")
    assert abs(geom - 0.5) < 1e-9 and abs(site - 0.5) < 1e-9
PY
