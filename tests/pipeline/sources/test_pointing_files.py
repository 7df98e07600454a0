"""No file of land, havens, depths or currents makes a library open a socket or another file.

The files lead to another file or an address in every way that GDAL, PROJ, SQLite or HDF5 know. Run
as a module, this reads those of a folder, each as what its name says, and prints how each ended.
"""

import json
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import geopandas
import h5py
import netCDF4
import numpy as np
import pyogrio
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.scenario.region import ChartSource
from pipeline.sources.cf.contents import read_contents
from pipeline.sources.combined_charts import DepthFile
from pipeline.sources.land.vector import VectorFile, read_havens
from tests.pipeline.kept import keep

REGION = shapely.box(119.5, 9.5, 120.5, 10.5)
ISLAND = shapely.box(120.0, 10.0, 120.1, 10.1)
GRIDS = (
    'GEOGCS["x",DATUM["Unknown",SPHEROID["GRS 1980",6378137,298.257222101],EXTENSION["PROJ4_GRIDS",'
    '"{file}"]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'
)
BOUND = (
    'BOUNDCRS[SOURCECRS[GEOGCRS["x",DATUM["Unk",ELLIPSOID["GRS 1980",6378137,298.257222101]],CS['
    'ellipsoidal,2],AXIS["longitude",east],AXIS["latitude",north],ANGLEUNIT["degree",'
    '0.0174532925199433]]],TARGETCRS[GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID['
    '"WGS 84",6378137,298.257223563]],CS[ellipsoidal,2],AXIS["latitude",north],AXIS["longitude",'
    'east],ANGLEUNIT["degree",0.0174532925199433]]],ABRIDGEDTRANSFORMATION["x to WGS84",METHOD['
    '"NTv2",ID["EPSG",9615]],PARAMETERFILE["Latitude and longitude difference file","{file}"]]]'
)
# Texts in which {url} and {file} are the address, and a file outside the folder.
TEXTS = {
    "vrt-file.vrt": '<OGRVRTDataSource><OGRVRTLayer name="secret"><SrcDataSource>{file}'
    "</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>",
    "vrt-address.geojson": '<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>/vsicurl/{url}'
    "</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>",
    "vrt-raster.vrt": '<VRTDataset rasterXSize="1" rasterYSize="1"><VRTRasterBand dataType="Byte" '
    'band="1"><SimpleSource><SourceFilename>{file}</SourceFilename></SimpleSource></VRTRasterBand>'
    "</VRTDataset>",
    "gdalg.gdalg.json": '{{"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline ! '
    'read {file} ! write streamed_dataset"}}',
    "wfs.xml": "<OGRWFSDataSource><URL>{url}</URL></OGRWFSDataSource>",
    "wms.xml": '<GDAL_WMS><Service name="WMS"><ServerUrl>{url}</ServerUrl></Service></GDAL_WMS>',
    "wmts.xml": "<GDAL_WMTS><GetCapabilitiesUrl>{url}</GetCapabilitiesUrl></GDAL_WMTS>",
    "wcs.xml": "<WCS_GDAL><ServiceURL>{url}</ServiceURL></WCS_GDAL>",
    "csw.xml": "<OGRCSWDataSource><URL>{url}</URL></OGRCSWDataSource>",
    "ogcapi.moaw": '{{"type": "Vector", "links": [{{"rel": "data", "href": "{url}"}}]}}',
    "stac.json": '{{"type": "FeatureCollection", "stac_version": "1.0.0", "features": [], "links": '
    '[{{"rel": "next", "href": "{url}"}}]}}',
    "schema.gml": '<ogr:FeatureCollection xmlns:ogr="http://ogr.maptools.org/" xmlns:gml="http://'
    'www.opengis.net/gml" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation='
    '"http://ogr.maptools.org/ {url}"><gml:featureMember><ogr:a><ogr:geometryProperty xlink:href='
    '"{url}" xmlns:xlink="http://www.w3.org/1999/xlink"/></ogr:a></gml:featureMember>'
    "</ogr:FeatureCollection>",
    "network.kml": '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><NetworkLink><Link><href>'
    "{url}</href></Link></NetworkLink><Placemark><styleUrl>{url}#a</styleUrl><Polygon>"
    "<outerBoundaryIs><LinearRing><coordinates>120,10 120.1,10 120.1,10.1 120,10</coordinates>"
    "</LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>",
    "entity.kml": '<!DOCTYPE kml [<!ENTITY x SYSTEM "file://{file}">]><kml xmlns="http://www.'
    'opengis.net/kml/2.2"><Document><name>&x;</name></Document></kml>',
    "link.gpx": '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1" xmlns:xsi'
    '="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="http://www.topografix.com/'
    'GPX/1/1 {url}"><wpt lat="10" lon="120"><link href="{url}"/></wpt></gpx>',
    "feed.rss": '<rss version="2.0" xmlns:georss="http://www.georss.org/georss"><channel><link>'
    "{url}</link><item><georss:point>10 120</georss:point></item></channel></rss>",
    "map.mapml": '<mapml- xmlns="http://www.w3.org/1999/xhtml"><map-head><map-link rel="next" href='
    '"{url}"/></map-head><map-body/></mapml->',
    "table.tab": '!table\n!version 300\nOpen Table "{file}" Hide\nCreate View x As Select * From '
    "secret\n",
    "seamless.tab": "!table\n!version 300\nDefinition Table\n Type NATIVE\n Fields 1\n File "
    '"{file}"\n',
    "xref.dxf": "0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n1\n{file}\n2\nx\n70\n4\n0\nENDSEC\n0\nEOF\n",
    "dump.sql": "CREATE TABLE x (a int);\n\\copy x FROM '{file}'\n",
    "osm.osm": '<osm version="0.6"><bounds minlat="9" minlon="119" maxlat="11" maxlon="121"/><node '
    'id="1" lat="10" lon="120"><tag k="url" v="{url}"/></node></osm>',
    "carto.json": '{{"CARTO": "{url}"}}',
    "esri.json": '{{"geometryType": "esriGeometryPoint", "exceededTransferLimit": true, '
    '"spatialReference": {{"wkt": "{file}"}}, "features": []}}',
    "topology.json": '{{"type": "Topology", "crs": {{"type": "link", "properties": {{"href": '
    '"{url}"}}}}, "objects": {{}}, "arcs": []}}',
    "jsonfg.json": '{{"type": "FeatureCollection", "conformsTo": ["[ogc-json-fg-1-0.1:core]"], '
    '"coordRefSys": {{"type": "Reference", "href": "{url}"}}, "features": []}}',
}
# Members "crs" of a GeoJSON.
CRS = {
    "link": '"crs": {"type": "link", "properties": {"href": "{url}"}}',
    "url": '"crs": {"type": "URL", "properties": {"url": "{url}"}}',
    "upper": '"CRS": {"TYPE": "LINK", "PROPERTIES": {"HREF": "{url}"}}',
    "escaped": r'"\u0063r\u0073" : {"type": "l\u0069nk", "properties": {"href": "{url}"}}',
    "file-link": '"crs": {"type": "link", "properties": {"href": "file://{file}"}}',
    "named-address": '"crs": {"type": "name", "properties": {"name": "{url}"}}',
    "named-file": '"crs": {"type": "name", "properties": {"name": "{file}"}}',
    "grids": '"crs": {"type": "name", "properties": {"name": "+proj=longlat +ellps=GRS80 '
    '+nadgrids={file} +type=crs"}}',
    "geoid": '"crs": {"type": "name", "properties": {"name": "+proj=longlat +datum=WGS84 '
    '+geoidgrids={file} +type=crs"}}',
    "init": '"crs": {"type": "name", "properties": {"name": "+init={file}:1"}}',
    "ogc": '"crs": {"type": "OGC", "properties": {"urn": "{url}"}}',
}
VIEWS = {
    "pixel": "SELECT fid AS OGC_FID, geom, gdal_get_pixel_value('{file}', 1, 'georef', 120, 10) "
    "AS name FROM land",
    "endless": "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS "
    "OGC_FID, geom, name FROM n, land",
    "layers": "SELECT fid AS OGC_FID, geom, ogr_datasource_load_layers('{file}') AS name FROM land",
}
MODULES = ("VirtualShape('{stem}', 'utf8', 4326)", "VirtualOGR('{file}')", "VirtualText('{file}')")


def write_all(folder: Path, address: str, outside: Path) -> None:
    """Write the files; `outside` is a folder with what they lead to."""
    frame = geopandas.GeoDataFrame({"name": ["A"]}, geometry=[ISLAND], crs=4326)
    secret = outside / "secret.shp"
    frame.to_file(secret)
    given = {"url": address, "file": str(secret), "stem": str(secret.with_suffix(""))}

    def filled(text: str) -> str:
        for key, value in given.items():
            text = text.replace(f"{{{key}}}", value)
        return text

    for name, text in TEXTS.items():
        (folder / name).write_text(text.format(**given))
    island = json.loads(shapely.to_geojson(ISLAND))
    feature = {"type": "Feature", "properties": {}, "geometry": island}
    collection = json.dumps({"type": "FeatureCollection", "features": [feature]})
    for name, crs in CRS.items():
        text = f"{{{filled(crs)}, {collection[1:]}"
        (folder / f"crs-{name}.geojson").write_text(text)
        (folder / f"havens-crs-{name}.geojson").write_text(text)
    inner = f"{{{filled(CRS['link'])}, {json.dumps(island)[1:]}"
    (folder / "crs-of-a-geometry.geojson").write_text(inner)
    nested = json.dumps({"type": "Feature", "properties": {}, "geometry": 0}).replace("0", inner)
    (folder / "crs-of-a-part.geojson").write_text(nested)
    (folder / "crs-of-a-line.geojsonl").write_text(f"{nested}\n{nested}\n")
    wkt = shapely.to_wkt(ISLAND)
    for at, crs in enumerate((GRIDS, BOUND, "{url}", "{file}")):
        frame.to_file(folder / f"prj-{at}.shp")
        for name in (f"prj-{at}", f"havens-prj-{at}", f"table-prj-{at}"):
            (folder / f"{name}.csv").write_text(f'name,lon,lat,WKT\na,120,10,"{wkt}"\n')
            (folder / f"{name}.prj").write_text(filled(crs))
        package = folder / f"crs-{at}.gpkg"
        frame.to_file(package)
        _change(package, "UPDATE gpkg_spatial_ref_sys SET definition = ?", filled(crs))
    pyogrio.raw.write(
        str(folder / "grids.fgb"),
        geometry=shapely.to_wkb(np.array([ISLAND], dtype=object)),
        field_data=[],
        fields=[],
        geometry_type="Polygon",
        crs=filled(GRIDS),
    )
    for name, view in VIEWS.items():
        package = folder / f"view-{name}.gpkg"
        frame.to_file(package, layer="land")
        _change(package, f"CREATE VIEW v AS {filled(view)}")
        _change(package, "UPDATE gpkg_contents SET table_name = 'v'")
        _change(package, "UPDATE gpkg_geometry_columns SET table_name = 'v'")
    for at, module in enumerate(MODULES):
        for create in ("CREATE VIRTUAL TABLE", "create/**/virtual/**/table"):
            package = folder / f"module-{at}-{len(create)}.gpkg"
            frame.to_file(package, layer="land")
            sql = f"{create} w USING {filled(module)}"
            _change(package, "INSERT INTO sqlite_master VALUES('table', 'w', 'w', 0, ?)", sql)
    package = folder / "contents.gpkg"
    frame.to_file(package, layer="land")
    _change(package, "ALTER TABLE gpkg_contents RENAME TO c")
    _change(
        package,
        "CREATE VIEW gpkg_contents AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM "
        "n) SELECT c.* FROM n, c",
    )
    _archives(folder, outside)
    _hdf5(folder, outside)


def _change(package: Path, sql: str, *values: str) -> None:
    """Change a GeoPackage, its schema too."""
    database = sqlite3.connect(package)
    database.execute("PRAGMA writable_schema = ON")
    for trigger in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'"):
        database.execute(f'DROP TRIGGER "{trigger[0]}"')
    database.execute(sql, values)
    database.commit()
    database.close()


def _archives(folder: Path, outside: Path) -> None:
    """Write archives of such files, and names that a library takes for other files' names."""
    for name, inner in (
        ("a.zip", "crs-link.geojson"),
        ("a.gpkg.zip", "crs-0.gpkg"),
        ("a.kmz", "network.kml"),
    ):
        with zipfile.ZipFile(folder / name, "w") as archive:
            archive.write(folder / inner, "doc.kml" if name.endswith("kmz") else inner)
    shapes = [folder / f"prj-0{suffix}" for suffix in (".shp", ".shx", ".dbf", ".prj")]
    with zipfile.ZipFile(folder / "a.shz", "w") as archive:
        for one in shapes:
            archive.write(one, one.name)
    (outside / "other.geojson").write_text(shapely.to_geojson(ISLAND))
    for name in (f"x!{outside.name}", "x;y"):
        (folder / f"{name}.geojson").write_text(shapely.to_geojson(ISLAND))


def _hdf5(folder: Path, outside: Path) -> None:
    """Write NetCDF 4 files whose eastward component or depths are elsewhere."""
    shape = (2, 20, 30)
    np.full(shape, 0.3, "f4").tofile(outside / "secret.bin")
    secret = outside / "secret.nc"
    _grid(secret)
    os.mkfifo(outside / "fifo")

    def is_virtual(file: h5py.File, name: str) -> None:
        layout = h5py.VirtualLayout(shape=file[name].shape, dtype="f4")
        layout[:] = h5py.VirtualSource(str(secret), name, shape=file[name].shape)
        del file[name]
        file.create_virtual_dataset(name, layout)

    def stored_in(raw: Path) -> Callable[[h5py.File, str], None]:
        def change(file: h5py.File, name: str) -> None:
            at = file[name].shape
            del file[name]
            file.create_dataset(name, at, "f4", external=[(str(raw), 0, h5py.h5f.UNLIMITED)])

        return change

    def linked(file: h5py.File, name: str) -> None:
        del file[name]
        file[name] = h5py.ExternalLink(str(secret), f"/{name}")

    def linked_softly(file: h5py.File, name: str) -> None:
        del file[name]
        file["e"] = h5py.ExternalLink(str(secret), "/")
        file[name] = h5py.SoftLink(f"/e/{name}")

    def linked_deep(file: h5py.File, name: str) -> None:
        group = file.create_group("a/b", track_order=True)
        for at in range(40):
            group[f"s{at}"] = h5py.SoftLink(f"/{name}")
        group["x"] = h5py.ExternalLink(str(secret), f"/{name}")

    changes = {
        "virtual": is_virtual,
        "external": stored_in(outside / "secret.bin"),
        "fifo": stored_in(outside / "fifo"),
        "linked": linked,
        "softly": linked_softly,
        "deep": linked_deep,
    }
    for name, change in changes.items():
        for kind, variable in (("currents", "uo"), ("depths", "elevation")):
            path = folder / f"{kind}-{name}.nc"
            _grid(path)
            with h5py.File(path, "a") as file:
                change(file, variable)


def _grid(path: Path) -> None:
    """Write currents and depths."""
    axes = {"latitude": np.arange(9, 11, 0.1), "longitude": np.arange(118, 121, 0.1)}
    with netCDF4.Dataset(path, "w") as file:
        for name, values in axes.items():
            file.createDimension(name, values.size)
            axis = file.createVariable(name, "f8", (name,))
            axis.units = "degrees_north" if name == "latitude" else "degrees_east"
            axis[:] = values
        file.createDimension("time", 2)
        time = file.createVariable("time", "f8", ("time",))
        time.units = "days since 2024-07-01"
        time[:] = [0.0, 1.0]
        for name in ("uo", "vo"):
            one = file.createVariable(name, "f4", ("time", *axes))
            one.units = "m s-1"
            one[:] = 0.2
        ground = file.createVariable("elevation", "f4", tuple(axes))
        ground.units = "m"
        ground[:] = -50.0


def read(path: Path) -> str:
    """Read a file as what its name says; return how that ended."""
    try:
        if path.name.startswith("havens"):
            read_havens(path)
        elif path.name.startswith("currents"):
            read_contents((path,))
        elif path.name.startswith("depths"):
            DepthFile.open(path)
        else:
            VectorFile(path, ChartSource(path=str(path), radius_m=20.0)).land(REGION)
    except RequestError as error:
        return f"refused: {error.faults[0]}"
    return "read"


def is_tried(path: Path) -> bool:
    """Whether a file is one of the tricks, and not beside one."""
    return path.suffix not in {".prj", ".shx", ".dbf", ".cpg"}


# What belongs to the process itself: names of its services, not of a file's addresses.
_TRACED = (
    "strace",
    "-f",
    "--seccomp-bpf",
    "-qq",
    "-e",
    "trace=open,openat,openat2,creat,socket,connect",
    "-o",
)


def test_havens_beside_a_fifo_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "havens.csv").write_text("name,lon,lat\na,120,10\n")
    os.mkfifo(tmp_path / "havens.prj")
    with pytest.raises(RequestError, match=r"havens\.prj is a FIFO, not a file"):
        read_havens(tmp_path / "havens.csv")


@pytest.fixture
def asked() -> list[bytes]:
    """Count what is asked of a loopback address."""
    found: list[bytes] = []
    listener = socket.create_server(("127.0.0.1", 0))

    def listen() -> None:
        while True:
            try:
                one, _ = listener.accept()
            except OSError:
                return
            found.append(b"")
            one.close()

    threading.Thread(target=listen, daemon=True).start()
    found.append(f"http://127.0.0.1:{listener.getsockname()[1]}/x".encode())
    return found


@pytest.mark.filterwarnings("ignore")
def test_files_that_lead_elsewhere_open_no_socket_and_no_other_file(
    tmp_path: Path, asked: list[bytes]
) -> None:
    folder, outside = tmp_path / "given", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    address = asked.pop().decode()
    write_all(folder, address, outside)
    command = [sys.executable, "-m", __name__, str(folder)]
    log = tmp_path / "opened"
    is_traced = shutil.which("strace") is not None and (
        subprocess.run([*_TRACED, "/dev/null", "true"], check=False).returncode == 0
    )
    # One that follows a FIFO, or a view without end, never ends.
    found = subprocess.run(
        [*_TRACED, str(log), *command] if is_traced else command,
        check=True,
        capture_output=True,
        text=True,
        timeout=240,
        env={**os.environ, "PYTHONWARNINGS": "ignore", "NO_PROXY": "*"},
    )
    ends = dict(line.split("\t") for line in found.stdout.splitlines())
    tried = {one.name for one in filter(is_tried, folder.iterdir())}
    assert ends.keys() == tried
    assert len(tried) > 40
    assert asked == []
    # What does not lead elsewhere after all: GDAL neither fetches nor opens such a name.
    harmless = ("-named-", "crs-ogc", "network.kml", "-prj-2", "-prj-3", "crs-2", "crs-3")
    read = [name for name, end in ends.items() if end == "read"]
    assert [name for name in read if not any(part in name for part in harmless)] == []
    if not is_traced:
        pytest.skip("strace is not here: which files were opened is not known")
    lines = log.read_text(errors="replace").splitlines()
    assert [line for line in lines if str(outside) in line or "AF_INET" in line] == []


if __name__ == "__main__":
    keep()
    for tried in sorted(filter(is_tried, Path(sys.argv[1]).iterdir())):
        print(f"{tried.name}\t{read(tried)}", flush=True)  # noqa: T201 - this is how it answers
