"""Columns of a register list, by the words of its heading line in several languages."""

from __future__ import annotations

import re
import unicodedata
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

COLUMNS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "address": (
            "address", "addr", "reg", "register", "registers", "register address", "reg address", "reg addr",
            "register number", "register no", "reg no", "reg nr", "modbus address", "modbus register", "modbus addr",
            "modbus reg", "start address", "data address", "dec address",
            "hex", "dec", "pdu address",
            "protocol address", "decimal", "plc address", "parameter address", "holding register", "input register",
            "adresse", "registeradresse", "register adresse", "modbus adresse", "modbusadresse", "registernummer",
            "register nr", "startadresse", "adr",
            "adresse modbus", "registre", "adresse registre", "adresse du registre", "numero de registre", "n registre",
            "direccion", "registro", "direccion modbus", "direccion de registro", "direccion del registro",
            "indirizzo", "indirizzo modbus", "indirizzo registro", "endereco", "registrador", "endereco modbus",
            "adres", "modbus adres", "registeradres", "rejestr", "adres modbus", "adres rejestru",
            "адрес", "регистр", "адрес регистра", "адрес modbus", "номер регистра",
            "地址", "寄存器", "寄存器地址", "modbus地址", "通讯地址", "参数地址",
        ),
        "name": (
            "name", "register name", "parameter name", "signal", "signal name", "tag", "tag name", "variable", "label",
            "variable name", "data name", "point", "point name", "item", "quantity", "description", "meaning", "title",
            "parameter", "function name", "content", "contents", "data", "text", "register",
            "bezeichnung", "beschreibung", "benennung", "bedeutung", "signalname", "messwert", "grosse", "inhalt",
            "variablenname", "parametername", "nom", "designation", "libelle", "parametre", "grandeur",
            "nombre", "descripcion", "parametro", "designacion", "nome", "descrizione", "denominazione", "grandezza",
            "descricao", "naam", "omschrijving", "beschrijving", "nazwa", "opis", "znaczenie",
            "имя", "название", "наименование", "описание", "параметр", "обозначение", "назначение",
            "名称", "参数名称", "描述", "说明", "功能", "含义", "名字", "参数",
        ),
        "unit": (
            "unit", "units", "uom", "eng unit", "engineering unit", "engineering units",
            "measure unit", "scale unit", "unit scale", "einheit",
            "unite", "unites", "unidad", "unidades", "unita", "unita di misura", "um", "unidade", "eenheid",
            "jednostka", "единица", "единицы", "ед изм", "единица измерения", "единицы измерения", "ед", "размерность",
            "单位",
        ),
        "factor": (
            "factor", "multiplier", "mult", "gain", "resolution", "lsb", "step", "scale factor", "scaling factor",
            "faktor", "skalierungsfaktor", "auflosung", "multiplikator", "schrittweite", "facteur", "resolucion",
            "facteur d echelle", "coefficient", "coef", "factor de escala", "multiplicador", "fattore",
            "fattore di scala", "risoluzione", "fator", "resolucao", "resolutie", "wspolczynnik", "mnoznik",
            "rozdzielczosc", "множитель", "коэффициент", "дискретность", "разрешение", "цена деления",
            "系数", "倍率", "分辨率", "最小单位", "精度",
        ),
        "scale": ("scale", "scaling", "skalierung", "echelle", "escala", "scala", "schaling", "skala", "масштаб",
            "比例"),
        "divisor": (
            "divisor", "divider", "div", "divide by", "teiler", "diviseur", "divisore", "deler", "dzielnik",
            "делитель", "除数",
        ),
        "decimals": (
            "decimals", "decimal places", "dp", "precision", "nachkommastellen", "dezimalstellen",
            "decimales", "decimali", "casas decimais", "decimalen", "знаков после запятой", "小数位", "小数位数",
        ),
        "offset": ("offset", "bias", "zero offset", "nullpunkt", "decalage", "desplazamiento", "смещение", "偏移"),
        "type": (
            "data type", "datatype", "data format", "type", "format", "value type", "register format", "typ",
            "datentyp", "datenformat", "type de donnees", "format de donnees", "tipo", "tipo de dato",
            "tipo de datos", "tipo dato", "tipo di dato", "tipo de dados", "gegevenstype", "typ danych",
            "тип", "тип данных", "формат", "формат данных", "类型", "数据类型", "数据格式", "格式",
        ),
        "function": (
            "function", "function code", "func", "fc", "read function", "modbus function", "register type",
            "reg type", "object type", "object", "table", "area", "memory area", "register kind", "functions",
            "funktion", "funktionscode", "registertyp", "registerart", "fonction", "code fonction",
            "type de registre", "funcion", "codigo de funcion", "tipo de registro", "funzione", "codice funzione",
            "tipo registro", "funcao", "functie", "functiecode", "funkcja", "kod funkcji",
            "функция", "код функции", "тип регистра", "功能码", "寄存器类型", "读功能码",
        ),
        "access": (
            "access", "rw", "r w", "read write", "attribute", "attr", "mode", "direction", "rights", "permission",
            "zugriff", "lesen schreiben", "acces", "lecture ecriture", "acceso", "lectura escritura", "accesso",
            "lettura scrittura", "acesso", "toegang", "dostep", "доступ", "чтение запись", "режим доступа",
            "读写", "属性", "访问", "权限",
        ),
        "order": (
            "word order", "byte order", "endian", "endianness", "endianess", "register order", "wortreihenfolge",
            "wortfolge", "byte reihenfolge", "ordre des mots", "orden de palabras", "ordine parole",
            "порядок слов", "порядок байт", "字节序", "字序",
        ),
        "values": (
            "values", "options", "enum", "enumeration", "value list", "states", "choices", "coding", "value text",
            "werte", "optionen", "auswahl", "zustande", "valeurs", "valores", "valori", "opties", "waarden",
            "wartosci", "значения", "варианты", "перечисление", "取值", "选项",
        ),
        "count": (
            "count", "length", "size", "registers count", "register count", "number of registers",
            "quantity of registers",
            "words", "no of registers", "len", "anzahl", "lange", "registeranzahl", "anzahl register", "longueur",
            "nombre de registres", "longitud", "lunghezza", "tamanho", "lengte", "dlugosc", "длина", "количество",
            "количество регистров", "数量", "长度", "寄存器数量",
        ),
        "bit": ("bit", "bit no", "bit number", "bit position", "bitnummer", "bitnr", "numero de bit", "бит", "位"),
    }
)  # fmt: skip
"""Headings of each column, in lower case without accents and punctuation.

If several headings match a column, the earliest in this list wins.
"""

NEEDED = ("address", "name")
_BASES = frozenset(("hex", "hexadecimal", "dec", "dez", "decimal", "dezimal"))
"""Words after an address heading that state the base of the numbers."""


def columns_in(cells: Sequence[str]) -> dict[str, int]:
    """Return the position of each column of COLUMNS that a heading line has."""
    headings = [_spellings(cell) for cell in cells]
    found: dict[str, int] = {}
    for column, known in COLUMNS.items():
        places = [place for word in known for place, each in enumerate(headings) if word in each]
        free = [place for place in places if place not in found.values()]
        if free:
            found[column] = free[0]
    if "address" in found:
        addresses = [place for place, each in enumerate(headings) if _is_address(each)]
        found["address"] = next((place for place in addresses if "hex" in headings[place]), found["address"])
    return found


def further_addresses(cells: Sequence[str], used: Mapping[str, int]) -> list[int]:
    """Return the columns that number the registers in another way than the address column in use."""
    return [place for place, cell in enumerate(cells) if place not in used.values() and _is_address(_spellings(cell))]


def _is_address(spellings: Collection[str]) -> bool:
    return any(word in spellings for word in COLUMNS["address"])


def _spellings(heading: str) -> list[str]:
    """Return the forms under which a heading may appear in COLUMNS: whole, without number base, and its parts."""
    whole = _bare(heading)
    base = [word for word in whole.split() if word in _BASES]
    without = " ".join(word for word in whole.split() if word not in _BASES)
    parts = [_bare(part) for part in re.split(r"[/|,]", heading)]
    named = ["hex"] if any(word.startswith("hex") for word in base) else []
    return [each for each in (whole, without, *parts, *named) if each]


def _bare(heading: str) -> str:
    """Return a heading in lower case, without accents, punctuation and a bracketed suffix."""
    text = unicodedata.normalize("NFKD", re.sub(r"(?<=\w)\s*[\[(](?!hex|dec|dez).*?[\])]", " ", heading.casefold()))
    kept = "".join(each for each in text if not unicodedata.combining(each) or each == "\u0306")
    return " ".join(re.sub(r"[^\w]+|_", " ", unicodedata.normalize("NFC", kept)).split())
