"""Public names of tactibench.live, and the modules that define them."""

from .answers import ask as ask
from .answers import describe_prediction as describe_prediction
from .answers import has_contact as has_contact
from .pages import PressPage as PressPage
from .pages import WatchPage as WatchPage
from .pins import PinLines as PinLines
from .press import MOST_TIPS as MOST_TIPS
from .press import PressRequest as PressRequest
from .press import PressSession as PressSession
from .press import Subject as Subject
from .server import MOST_BYTES as MOST_BYTES
from .server import MOST_CONNECTIONS as MOST_CONNECTIONS
from .server import LocalServer as LocalServer
from .views import AnswerView as AnswerView
from .views import FrameView as FrameView
from .views import contact_errors as contact_errors
from .views import pack as pack
