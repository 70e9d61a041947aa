"""What a session imports: a small computer holds it all in memory."""

import subprocess
import sys

HEAVY = "scipy.stats", "scipy.ndimage", "scipy.optimize", "matplotlib", "rclpy"


def test_a_session_with_every_method_imports_no_heavy_module_that_it_does_not_use():
    code = (
        "import sys, tsepm_ros.session.session, tsepm_ros.methods.registry; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
