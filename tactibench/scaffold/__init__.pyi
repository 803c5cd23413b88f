"""Public names of tactibench.scaffold, and the modules that define them."""

from .package import Names as Names
from .package import check_name as check_name
from .package import render_templates as render_templates
from .package import write_package as write_package
