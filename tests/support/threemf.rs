//! Writes 3MF archives.

use super::meshes::png;
use super::npz;

/// Returns a model in inches: a coloured tetrahedron with one more triangle under a texture. It
/// occurs twice: enlarged twofold, and mirrored as a component of another file.
pub(crate) fn model() -> String {
    r##"<?xml version="1.0" encoding="UTF-8"?>
<model unit="inch" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
 xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
 xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">
 <resources>
  <basematerials id="10"><base name="a" displaycolor="#FF0000"/></basematerials>
  <m:colorgroup id="11"><m:color color="#FF0000FF"/><m:color color="#0080FF80"/></m:colorgroup>
  <m:texture2d id="12" path="/3D/a.png" contenttype="image/png" tilestyleu="clamp"/>
  <m:texture2dgroup id="13" texid="12"><m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0"/><m:tex2coord u="0" v=".75"/></m:texture2dgroup>
  <object id="1" pid="10" pindex="0"><mesh>
   <vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/></vertices>
   <triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="3" v3="2"/>
    <triangle v1="1" v2="2" v3="3" pid="11" p1="0" p2="0" p3="1"/></triangles>
  </mesh></object>
  <object id="2"><mesh>
   <vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices>
   <triangles><triangle v1="0" v2="1" v3="2" pid="13" p1="0" p2="1" p3="2"/></triangles>
  </mesh></object>
  <object id="3"><components><component objectid="1" transform="2 0 0 0 2 0 0 0 2 0 0 0"/></components></object>
 </resources>
 <build>
  <item objectid="3" transform="1 0 0 0 1 0 0 0 1 10 20 30"/>
  <item objectid="2"/>
  <item objectid="7" p:path="/3D/part.model"/>
 </build>
</model>"##
        .to_owned()
}

const PART: &str = r#"<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
 xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"><resources>
 <object id="7"><components><component objectid="1" p:path="/3D/a.model" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/></components></object>
</resources><build/></model>"#;

/// Returns an archive of this model, of another that names it and of an image.
pub(crate) fn archive(model: &str) -> Vec<u8> {
    let relations = r#"<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
        <Relationship Target="/3D/a.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>"#;
    let image = png(2, &[[255, 0, 0, 255], [0, 255, 0, 255]].repeat(2));
    npz(
        &[
            ("_rels/.rels", relations.into()),
            ("3D/a.model", model.into()),
            ("3D/part.model", PART.into()),
            ("3D/a.png", image),
        ],
        true,
    )
}

pub(crate) fn rich() -> Vec<u8> {
    archive(&model())
}
