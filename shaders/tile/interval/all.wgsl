// Interval: the whole ray of a pixel.

const HAS_SURFACE: bool = false;
const span: Span = WHOLE_SPAN;

fn begin_interval_of_tile() {}

fn begin_interval(own: TilePixel, ray: TileRay) {}

fn prepare_interval(n: u32, i: u32) {}

fn side_of(n: u32) -> u32 {
    return SIDE_FRONT;
}

fn shows_behind() -> bool {
    return false;
}
