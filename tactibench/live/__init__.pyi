from .answers import ask as ask
from .answers import describe_prediction as describe_prediction
from .answers import has_contact as has_contact
from .pages import PressPage as PressPage
from .pages import WatchPage as WatchPage
from .pins import PinLines as PinLines
from .views import AnswerView as AnswerView
from .views import FrameView as FrameView
