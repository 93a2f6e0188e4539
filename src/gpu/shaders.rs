//! Lists every shader of the back end, for tools that inspect their texts.

use super::shader::{STRUCTS, Shader};
use super::{
    bin, classify, compose, cull, f64, gather, light, merged, present, project, radix, rasterise,
    resolve, scan, shade, sort, surface,
};

/// The structs of [`crate::record`] alone.
const LAYOUT: Shader = Shader::new("layout", &[STRUCTS]);

impl Shader {
    /// Returns every shader of the back end.
    pub fn all() -> Vec<Self> {
        let mut all = vec![
            LAYOUT,
            f64::SHADER,
            merged::SHADER,
            scan::SHADER,
            cull::SHADER,
            classify::SHADER,
            classify::PIECES,
            classify::NEIGHBOURS,
            classify::AMPLITUDES,
            shade::SHADER,
            shade::ENCODE_SHADER,
            radix::SHADER,
            sort::SHADER,
            gather::SHADER,
            bin::SHADER,
            compose::SHADER,
            surface::SHADER,
            resolve::SHADER,
            present::SHADER,
        ];
        all.extend(light::SHADERS);
        all.extend(project::SHADERS);
        all.extend(rasterise::shaders());
        all
    }
}
