from .emission import Emission as Emission
from .form import Form as Form, kind_of as kind_of, message_of as message_of
from .leaf import Leaf as Leaf, LeafFault as LeafFault, Until as Until, deciding as deciding, until as until
from .leaves import (
    CheckCharacters as CheckCharacters,
    characters as characters,
    choice as choice,
    constant as constant,
    decimal_number as decimal_number,
    decimal_sum as decimal_sum,
    filler as filler,
    hex_number as hex_number,
    hex_sum as hex_sum,
    hex_text as hex_text,
    hex_value as hex_value,
    one_of as one_of,
    shifted_character as shifted_character,
    signed as signed,
    unsigned as unsigned,
    unsure as unsure,
    xor_byte as xor_byte,
)
from .registers import (
    bits_as as bits_as,
    bits_in as bits_in,
    bytes_as as bytes_as,
    bytes_in as bytes_in,
    crc16 as crc16,
    numbered_texts_as as numbered_texts_as,
    numbered_texts_in as numbered_texts_in,
    numbers as numbers,
    whole as whole,
    words_as as words_as,
    words_in as words_in,
    wrong_field as wrong_field,
)
from .telegrams import Telegrams as Telegrams
from .telegrams_by_length import TelegramsByLength as TelegramsByLength
