//! The muscle as a thermal camera shows it: the paper's Fig. 2, drawn from the plant's zones.

use std::f64::consts::PI;
use std::hash::{DefaultHasher, Hash, Hasher};

use maud::{Markup, html};

use super::axes::{Area, FOOT, ticks};
use super::chart::{FULL_WIDTH, NARROW_WIDTH};
use super::colour::{fraction, hex};
use super::figure::{Drawing, Figure};
use super::heatmap::colour_bar;
use super::path::Path;
use super::scale::{Scale, Spacing, data_range, with_room};
use thermyo_files::number::{fixed, px};

/// The usual map of thermal cameras: black, purple, orange, pale yellow.
const MAP: colorous::Gradient = colorous::INFERNO;
const ZERO_CELSIUS_K: f64 = 273.15;

/// `count` colours of the map, cold to hot, for a page with its own drawing of a muscle.
pub fn palette(count: usize) -> Vec<String> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| hex(MAP, i as f64 / last)).collect()
}

// Layout of the picture across a page [px].
const LEFT: f64 = 142.0;
const RIGHT: f64 = 650.0;
const LENGTH: f64 = RIGHT - LEFT;
const AXIS_Y: f64 = 120.0;
const RADIUS: f64 = 46.0;
const FITTING_RADIUS: f64 = 17.0;
/// Length over which the body tapers to a fitting.
const TAPER: f64 = 66.0;

/// A dark picture above, the axial profile below \[px\].
struct Layout {
    width: f64,
    picture_height: f64,
    /// Scale of the picture, and position of its axis at the port.
    scale: f64,
    port: (f64, f64),
    /// Heights of the labels of the coldest and of the hottest zone.
    extremes: [f64; 2],
    /// Left, top and bottom of the colour bar.
    bar: (f64, f64, f64),
    profile: Area,
}

/// Layout across the page: the profile is below the muscle.
const WIDE: Layout = Layout {
    width: FULL_WIDTH,
    picture_height: 224.0,
    scale: 1.0,
    port: (LEFT, AXIS_Y),
    extremes: [AXIS_Y - RADIUS - 28.0; 2],
    bar: (786.0, 44.0, 196.0),
    profile: Area { left: LEFT, right: RIGHT, top: 264.0, bottom: 374.0 },
};

/// Layout for a phone: the text keeps its size and the muscle is smaller.
const NARROW: Layout = Layout {
    width: NARROW_WIDTH,
    picture_height: 136.0,
    scale: 0.44,
    port: (34.0, 70.0),
    extremes: [24.0, 124.0],
    bar: (304.0, 36.0, 116.0),
    profile: Area { left: 48.0, right: 346.0, top: 176.0, bottom: 286.0 },
};

impl Layout {
    /// Position along the muscle in the drawing.
    fn along(&self, at: f64) -> f64 {
        self.port.0 + (at - LEFT) * self.scale
    }
}

/// Length of a thread's half turn along the axis, and distance of adjacent threads.
const HALF_TURN: f64 = 190.0;
const THREAD_PITCH: f64 = 9.5;
/// Stops of the body's gradient: the colour map is not linear between zones.
const STOPS: usize = 48;

/// A McKibben muscle with a temperature per axial zone.
#[derive(Debug, Clone, PartialEq)]
pub struct Muscle {
    /// Surface temperature per zone, port first \[K\]. Zones are of equal length.
    pub zones_k: Vec<f64>,
    /// Ends of the colour scale \[degC\]; the paper's are 20 and 40.
    pub scale_degc: (f64, f64),
}

impl Muscle {
    /// A muscle on the paper's colour scale, 20 to 40 degC.
    pub fn new(zones_k: &[f64]) -> Self {
        Self { zones_k: zones_k.to_vec(), scale_degc: (20.0, 40.0) }
    }

    /// The drawing. Zones that are not finite are left out; without zones the body is drawn cold.
    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let drawings = html! {
            (self.svg(title, &self.id(), &WIDE))
            // Gradients of a hidden drawing cannot be used: each drawing has its own.
            (self.svg(title, &format!("{}-narrow", self.id()), &NARROW))
        };
        Figure::new(title, caption, Drawing::still(html! {}, drawings))
    }

    fn svg(&self, title: &str, id: &str, layout: &Layout) -> Markup {
        let zones = self.zones();
        let narrow = layout.width < FULL_WIDTH;
        let height = layout.profile.bottom + FOOT;
        let (bar, top, bottom) = layout.bar;
        let (x, y) = (layout.along(0.0), layout.port.1 - AXIS_Y * layout.scale);
        html! {
            svg.chart.narrow[narrow] xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(title)
                width=(px(layout.width)) height=(px(height)) viewBox={ "0 0 " (px(layout.width)) " " (px(height)) } {
                (self.definitions(id, &zones))
                rect width=(px(layout.width)) height=(px(layout.picture_height)) rx="8" fill="#0b0a14" {}
                @if !narrow { (connections()) }
                g transform={ "translate(" (px(x)) " " (px(y)) ") scale(" (layout.scale) ")" } {
                    (body(id, if narrow { html! { use href={ "#" (self.id()) "-threads" } {} } } else { threads(id) }))
                    (fittings(id))
                }
                (extremes(&zones, layout))
                g.on-dark {
                    (colour_bar(MAP, self.scale_degc, Spacing::Linear, "°C", (bar, layout.width), (top, bottom)))
                }
                (self.profile(&zones, layout.profile))
            }
        }
    }

    /// Position of each zone's centre \[px\] and its temperature \[degC\].
    fn zones(&self) -> Vec<(f64, f64)> {
        let count = self.zones_k.len() as f64;
        let centre = |i: usize| LEFT + LENGTH * (i as f64 + 0.5) / count;
        let zones = self.zones_k.iter().enumerate().map(|(i, t)| (centre(i), t - ZERO_CELSIUS_K));
        zones.filter(|(_, t)| t.is_finite()).collect()
    }

    /// Ids are shared by the whole page: equal ids belong to equal drawings.
    fn id(&self) -> String {
        let mut hasher = DefaultHasher::new();
        let values = self.zones_k.iter().chain([&self.scale_degc.0, &self.scale_degc.1]);
        values.for_each(|v| v.to_bits().hash(&mut hasher));
        format!("muscle-{:08x}", hasher.finish() as u32)
    }

    fn definitions(&self, id: &str, zones: &[(f64, f64)]) -> Markup {
        let stop = |i: usize| {
            let offset = i as f64 / (STOPS - 1) as f64;
            let temperature =
                interpolate(zones, LEFT + LENGTH * offset).unwrap_or(self.scale_degc.0);
            (offset, hex(MAP, fraction(temperature, self.scale_degc)))
        };
        html! {
            defs {
                linearGradient id={ (id) "-heat" } gradientUnits="userSpaceOnUse"
                    x1=(px(LEFT)) x2=(px(RIGHT)) y1="0" y2="0" {
                    @for (offset, colour) in (0..STOPS).map(stop) {
                        stop offset=(format!("{offset:.3}")) stop-color=(colour) {}
                    }
                }
                // Shading: the flanks turn away from the viewer, light falls from above.
                linearGradient id={ (id) "-round" } x1="0" x2="0" y1="0" y2="1" {
                    stop offset="0" stop-color="#000" stop-opacity=".62" {}
                    stop offset=".2" stop-color="#000" stop-opacity=".16" {}
                    stop offset=".36" stop-color="#fff" stop-opacity=".2" {}
                    stop offset=".52" stop-color="#fff" stop-opacity="0" {}
                    stop offset=".78" stop-color="#000" stop-opacity=".2" {}
                    stop offset="1" stop-color="#000" stop-opacity=".7" {}
                }
                linearGradient id={ (id) "-metal" } x1="0" x2="0" y1="0" y2="1" {
                    stop offset="0" stop-color="#23222e" {}
                    stop offset=".3" stop-color="#8d8c9c" {}
                    stop offset=".45" stop-color="#5d5c6c" {}
                    stop offset="1" stop-color="#191822" {}
                }
                filter id={ (id) "-glow" } x="-10%" width="120%" y="-60%" height="220%" {
                    feGaussianBlur stdDeviation="14" {}
                }
            }
        }
    }

    fn profile(&self, zones: &[(f64, f64)], area: Area) -> Markup {
        let range =
            with_room(data_range(zones.iter().map(|(_, t)| *t), Spacing::Linear), Spacing::Linear);
        let y = Scale::new(range, (area.bottom, area.top), Spacing::Linear);
        let x = Scale::new((0.0, 1.0), (area.left, area.right), Spacing::Linear);
        let along = |at: f64| x.position((at - LEFT) / LENGTH);
        let x_ticks = ticks(&x, 5.0);
        let line = Path::through(zones.iter().map(|(at, t)| (along(*at), y.position(*t))));
        html! {
            text.axis x=(px(area.left - 44.0)) y=(px(area.top - 12.0)) { "Wall temperature [°C]" }
            (area.draw(&x_ticks, &ticks(&y, 4.0)))
            (area.x_axis(&x_ticks, "Position along the muscle, port to closed end [–]"))
            path.c-ink.line d=(line.data()) {}
            @for (at, t) in zones {
                circle.zone cx=(px(along(*at))) cy=(px(y.position(*t))) r="5" fill=(hex(MAP, fraction(*t, self.scale_degc))) {}
            }
        }
    }
}

/// Interpolates linearly between the zones' centres; constant beyond the outermost.
fn interpolate(zones: &[(f64, f64)], at: f64) -> Option<f64> {
    let after = zones.partition_point(|(x, _)| *x < at);
    match (after.checked_sub(1).map(|i| zones[i]), zones.get(after)) {
        (Some((x0, t0)), Some((x1, t1))) => Some(t0 + (t1 - t0) * (at - x0) / (x1 - x0)),
        (Some((_, t)), None) | (None, Some(&(_, t))) => Some(t),
        (None, None) => None,
    }
}

/// The body's radius at `along` from the port fitting \[px\].
fn radius(along: f64) -> f64 {
    let from_end = along.min(LENGTH - along).clamp(0.0, TAPER);
    FITTING_RADIUS + (RADIUS - FITTING_RADIUS) * (from_end / TAPER * PI / 2.0).sin()
}

fn outline() -> Path {
    let steps = || (0..=60).map(|i| LENGTH * f64::from(i) / 60.0);
    let upper = steps().map(|s| (LEFT + s, AXIS_Y - radius(s)));
    let lower = steps().rev().map(|s| (LEFT + s, AXIS_Y + radius(s)));
    let mut path = Path::default();
    path.area(upper.chain(lower));
    path
}

/// The visible halves of all threads of one direction: helices seen from the side.
fn one_way(direction: f64) -> Path {
    let mut path = Path::default();
    let count = ((LENGTH + HALF_TURN) / THREAD_PITCH) as i32;
    for i in 0..count {
        let start = -HALF_TURN + THREAD_PITCH * (f64::from(i) + 0.5);
        let from = start.max(0.0);
        let to = (start + HALF_TURN).min(LENGTH);
        path.polyline((0..=14).map(|step| from + (to - from) * f64::from(step) / 14.0).map(
            |along| {
                let angle = PI * ((along - start) / HALF_TURN - 0.5);
                (LEFT + along, AXIS_Y + direction * radius(along) * angle.sin())
            },
        ));
    }
    path
}

/// All threads, for reuse in another drawing.
fn threads(id: &str) -> Markup {
    html! {
        g id={ (id) "-threads" } fill="none" stroke-linecap="butt" {
            path d=(one_way(1.0).data()) stroke="#000" stroke-opacity=".38" stroke-width="1.6" {}
            path d=(one_way(-1.0).data()) stroke="#fff" stroke-opacity=".2" stroke-width="1.1" {}
        }
    }
}

fn body(id: &str, threads: Markup) -> Markup {
    let outline = outline();
    html! {
        path d=(outline.data()) fill={ "url(#" (id) "-heat)" } filter={ "url(#" (id) "-glow)" } opacity=".45" {}
        path d=(outline.data()) fill={ "url(#" (id) "-heat)" } {}
        (threads)
        path d=(outline.data()) fill={ "url(#" (id) "-round)" } {}
    }
}

fn fittings(id: &str) -> Markup {
    let metal = format!("url(#{id}-metal)");
    html! {
        // Port: tube stub, crimped ferrule.
        rect x=(px(LEFT - 50.0)) y=(px(AXIS_Y - 9.0)) width="24" height="18" fill=(metal) {}
        rect x=(px(LEFT - 30.0)) y=(px(AXIS_Y - 21.0)) width="36" height="42" rx="4" fill=(metal) {}
        // Closed end: ferrule, plug.
        rect x=(px(RIGHT - 6.0)) y=(px(AXIS_Y - 21.0)) width="36" height="42" rx="4" fill=(metal) {}
        rect x=(px(RIGHT + 28.0)) y=(px(AXIS_Y - 12.0)) width="14" height="24" rx="2" fill=(metal) {}
        path fill="none" stroke="#0b0a14" stroke-opacity=".65" stroke-width="1.5"
            d={ @for x in [LEFT - 21.0, LEFT - 12.0, LEFT - 3.0, RIGHT + 3.0, RIGHT + 12.0, RIGHT + 21.0] {
                "M" (px(x)) " " (px(AXIS_Y - 20.0)) "v40"
            } } {}
    }
}

/// Air on the left, hook and load on the right.
fn connections() -> Markup {
    let hook = RIGHT + 42.0;
    html! {
        g.on-dark {
            path.sketch d={ "M14 " (px(AXIS_Y)) "h56m-9-6l9 6-9 6" } {}
            text.small x="42" y=(px(AXIS_Y - 16.0)) text-anchor="middle" { "air" }
            text.small x=(px(LEFT - 26.0)) y=(px(AXIS_Y + 46.0)) text-anchor="middle" { "port" }
            text.small x=(px(RIGHT + 26.0)) y=(px(AXIS_Y + 46.0)) text-anchor="middle" { "closed end" }
            path.sketch d={ "M" (px(hook)) " " (px(AXIS_Y)) "h6a7 7 0 1 1 14 0a7 7 0 1 1-14 0" } {}
            path.sketch d={ "M" (px(hook + 20.0)) " " (px(AXIS_Y)) "h44m-9-6l9 6-9 6" } {}
            text.small x=(px(hook + 44.0)) y=(px(AXIS_Y - 16.0)) text-anchor="middle" { "load" }
        }
    }
}

/// Cross hairs at the coldest and the hottest zone, as in a thermal camera.
fn extremes(zones: &[(f64, f64)], layout: &Layout) -> Markup {
    let coldest = zones.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let hottest =
        zones.iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|hottest| Some(*hottest) != coldest);
    html! {
        g.on-dark {
            @for ((name, zone), text_y) in [("min", coldest), ("max", hottest)].into_iter().zip(layout.extremes) {
                @if let Some((at, t)) = zone {
                    @let (x, y) = (layout.along(*at), layout.port.1);
                    // The leader ends short of cross hairs and text, above or below.
                    @let (near, far) = if text_y < y { (y - 14.0, text_y + 6.0) } else { (y + 14.0, text_y - 14.0) };
                    path.sketch d={ "M" (px(x)) " " (px(y - 10.0)) "v7m0 6v7m-10-10h7m6 0h7" } {}
                    path.leader d={ "M" (px(x)) " " (px(near)) "V" (px(far)) } {}
                    text.small x=(px(x.clamp(layout.along(LEFT) + 26.0, layout.along(RIGHT) - 26.0))) y=(px(text_y))
                        text-anchor="middle" { (name) " " (fixed(*t, 1)) " °C" }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temperature_is_linear_between_zone_centres() {
        let zones = [(100.0, 20.0), (200.0, 30.0)];
        assert_eq!(interpolate(&zones, 150.0), Some(25.0));
        assert_eq!(interpolate(&zones, 0.0), Some(20.0));
        assert_eq!(interpolate(&zones, 900.0), Some(30.0));
        assert_eq!(interpolate(&[], 1.0), None);
    }
}
