from .application import description as description
from .door import HttpDoor as HttpDoor, LocalDoor as LocalDoor, http_door as http_door
from .guard import check_place as check_place, guarded as guarded, own_names as own_names
from .page_files import files_of as files_of
from .serving import serve as serve
