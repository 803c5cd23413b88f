"""Public names of tactibench.live, and the modules that define them."""

from .pages import MOST_BYTES as MOST_BYTES
from .pages import LocalServer as LocalServer
from .pages import PressPage as PressPage
from .pages import WatchPage as WatchPage
from .press import MOST_TIPS as MOST_TIPS
from .press import PressRequest as PressRequest
from .press import PressSession as PressSession
from .press import Subject as Subject
from .views import AnswerView as AnswerView
from .views import FrameView as FrameView
from .views import PinLines as PinLines
from .views import ask as ask
from .views import contact_errors as contact_errors
from .views import describe_prediction as describe_prediction
from .views import pack as pack
