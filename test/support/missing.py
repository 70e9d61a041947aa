"""Executables of the package where some modules cannot be imported, as where they are missing."""


def script(executable: str, missing: tuple[str, ...]) -> str:
    """Code that runs an executable; an import of a missing module or of what is in it fails."""
    return f"""
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if any(name == one or name.startswith(one + ".") for one in {missing!r}):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
from tsepm_ros import ending_signals
raise SystemExit(ending_signals.{executable}())
"""
