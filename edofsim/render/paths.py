"""A path tracer that carries every band along one path.

One path serves all bands: throughput and radiance are vectors over bands, and a surface's f at each band
comes from two evaluations of Mitsuba's own BSDF (see `translate`). Light is found by next-event estimation
and by BSDF sampling, weighted by the balance heuristic. Directions are chosen alike for all bands, so that
the noise of the bands is correlated and spectra stay smooth.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .meshes import CARRIER
from .rays import Lens, Samples, behind, camera_rays, object_row
from .sampling import combined, pair
from .translate import (
    BASIS,
    FIELDS,
    HEIGHT,
    INDEX,
    REPEATS,
    ROWS,
    TEXTURE,
    WIDTH,
    FewLights,
    Stage,
)

HERO = 0xB0
"""Names the random numbers that choose a path's own band."""

ROULETTE_DEPTH = 6
"""Paths longer than this end at random, by their brightest band; shorter ones never do."""


def trace(
    stage: Stage, lens: Lens, samples: Samples, gap: float, max_depth: int
) -> tuple[mi.ArrayXf, mi.Float, mi.Bool]:
    """Radiance [band, sample], inverse depth [sample], and whether there is a surface to see [sample].

    Layer 0 is what the pinhole sees; layer n is what it would see if the first n surfaces of each ray were
    not there *for that ray*: their shadows and reflections stay. max_depth counts as Mitsuba's: 1 is emitted
    light alone, 2 adds direct light. Not evaluated: the caller evaluates all three together.
    """
    rays = camera_rays(lens, samples)
    ray, exists = rays.ray, dr.full(mi.Bool, True, samples.size)
    if samples.layer > 0:
        ray, exists, _ = behind(stage, ray, rays.limits, dr.opaque(mi.Float, gap))
    else:
        ray.o = ray.o + dr.zeros(mi.Point3f, samples.size)
    seed = combined(rays.seed, dr.opaque(mi.UInt32, samples.layer))
    # in memory, so that one kernel walks on from there, whatever the layer: its compilation takes longest
    dr.make_opaque(ray.o, ray.d, rays.index, seed, exists)
    ray = mi.Ray3f(ray.o, ray.d)
    radiance, inverse_depth = walk(stage, ray, rays.index, seed, exists, dr.opaque(mi.UInt32, max_depth))
    return radiance, inverse_depth, exists


@dr.syntax
def walk(
    stage: Stage, ray: mi.Ray3f, index: mi.UInt32, seed: mi.UInt32, active: mi.Bool, max_depth: mi.UInt32
) -> tuple[mi.ArrayXf, mi.Float]:
    """Radiance [band, sample] along given rays and inverse depth [sample] of what they meet first.

    index, seed: UInt32 [sample], what the paths' random numbers follow from.
    active: Bool [sample], rays that exist.
    max_depth: UInt32, counts as in `trace`.
    """
    count = dr.width(index)
    radiance = dr.zeros(mi.ArrayXf, (stage.bands, count))
    throughput = dr.ones(mi.ArrayXf, (stage.bands, count))
    inverse_depth = dr.zeros(mi.Float, count)
    ray = mi.Ray3f(ray)
    active = mi.Bool(active)
    depth = mi.UInt32(0)
    last = dr.zeros(mi.SurfaceInteraction3f)
    last_pdf = mi.Float(1.0)
    last_delta = mi.Bool(True)
    # The band that a path goes on in behind dispersive glass, where each goes its own way
    hero = mi.UInt32(pair(index, combined(seed, mi.UInt32(HERO)), mi.Float)[0] * stage.bands)
    alone = mi.Bool(False)
    context = mi.BSDFContext()
    while dr.hint(active, exclude=[stage]):
        si = stage.scene.ray_intersect(ray, mi.RayFlags.All, coherent=depth == 0, active=active)
        inverse_depth = dr.select((depth == 0) & si.is_valid(), dr.rcp(si.p.z), inverse_depth)

        # A light that the path ran into
        emitter = si.emitter(stage.scene, active)
        lit = active & (emitter != None)  # noqa: E711 - an array of pointers
        if dr.hint(lit, exclude=[stage]):
            ds = mi.DirectionSample3f(stage.scene, si, last)
            light_pdf = stage.scene.pdf_emitter_direction(last, ds, lit & ~last_delta)
            weight = dr.select(last_delta, 1.0, last_pdf / (last_pdf + light_pdf))
            front = dr.select(emitter.eval(si, lit)[0] > 0, weight, 0.0)
            radiance = radiance + throughput * light(stage, emitter, ray.d, lit) * front

        on = active & si.is_valid() & (depth + 1 < max_depth)
        step = combined(seed, depth)
        toward_light = mi.Point2f(*pair(index, combined(step, mi.UInt32(1)), mi.Float))
        choice = pair(index, combined(step, mi.UInt32(2)), mi.Float)
        onward = mi.Point2f(*pair(index, combined(step, mi.UInt32(3)), mi.Float))

        # A light that the path looks for, and the next direction
        ds, arriving = stage.scene.sample_emitter_direction(si, toward_light, True, on)
        bsdf = si.bsdf(ray)
        value, pdf, sample, weight = bsdf.eval_pdf_sample(
            context, si, si.to_local(ds.d), choice[0], onward, on
        )
        fields = object_fields(stage, si, on)
        rho = reflectance(stage, fields, si.uv, on)
        seen = on & (ds.pdf > 0) & (arriving[0] > 0)
        share = dr.select(seen, dr.select(ds.delta, 1.0, ds.pdf / (ds.pdf + pdf)) / ds.pdf, 0.0)
        radiance = radiance + throughput * affine(rho, value * share) * light(stage, ds.emitter, ds.d, seen)

        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        if dr.hint(stage.disperses, mode="scalar"):
            bends = on & (fields[INDEX] > 0)
            toward, passed = refracted(stage, fields[INDEX] - 1, hero, si.wi, choice[0], bends)
            throughput = in_band(throughput, hero, bends & ~alone)
            alone |= bends
            delta |= bends
            weight = dr.select(bends, passed, weight)
            sample.wo = dr.select(bends, toward, sample.wo)
            sample.pdf = dr.select(bends, 1.0, sample.pdf)

        throughput = throughput * affine(rho, weight)
        largest = dr.max(throughput)
        survival = dr.select(depth + 1 >= ROULETTE_DEPTH, dr.minimum(largest, 0.95), 1.0)
        on &= (largest > 0) & (choice[1] < survival)
        throughput = throughput * dr.select(on, dr.rcp(survival), 0.0)
        ray = si.spawn_ray(si.to_world(sample.wo))
        last = dr.detach(si)
        last_pdf = sample.pdf
        last_delta = delta
        active = on
        depth += 1
    return radiance, inverse_depth


def affine(rho: mi.ArrayXf, carried: mi.Color3f) -> mi.ArrayXf:
    """f(band) = f0 + rho(band) (f1 - f0), from a BSDF's values with the carrier as reflectance."""
    return dr.fma(rho, carried[1] - carried[0], carried[0])


def spectrum(stage: Stage, row: mi.UInt32, active: mi.Bool) -> mi.ArrayXf:
    """One row of the table of spectra, [band, lane]."""
    packets = dr.gather(mi.ArrayXf, stage.spectra, row, active, shape=(stage.stride, dr.width(row)))
    return mi.ArrayXf([packets[band] for band in range(stage.bands)])


@dr.syntax
def mixed(stage: Stage, row: mi.UInt32, coefficients: list[mi.Float], active: mi.Bool) -> mi.ArrayXf:
    """sum_j coefficient_j spectrum(row + j), [band, lane]; what no lane has any of is not looked up."""
    total = spectrum(stage, row, active) * coefficients[0]
    for j in range(1, ROWS):
        share = coefficients[j]
        mixes = active & (share != 0)
        if dr.hint(mixes, exclude=[stage]):
            total = dr.fma(spectrum(stage, row + j, mixes), share, total)
    return total


def object_fields(stage: Stage, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.ArrayXu:
    """The table's entry of what was hit, [field, lane]."""
    row = object_row(stage, si, active)
    return dr.gather(mi.ArrayXu, stage.objects, row, active, shape=(FIELDS, dr.width(row)))


def reflectance(stage: Stage, fields: mi.ArrayXu, uv: mi.Point2f, active: mi.Bool) -> mi.ArrayXf:
    """Reflectance of what was hit, [band, lane]."""
    if not stage.has_textures:
        return spectrum(stage, fields[BASIS], active)
    textured = active & (fields[WIDTH] > 0)
    texel = texel_at(stage, fields, uv, fields[REPEATS] > 0, fields[REPEATS] > 0, textured)
    coefficients = [dr.select(textured, texel[j], 1.0 if j == 0 else 0.0) for j in range(ROWS)]
    return mixed(stage, fields[BASIS], coefficients, active)


def refracted(
    stage: Stage, row: mi.UInt32, hero: mi.UInt32, wi: mi.Vector3f, choice: mi.Float, active: mi.Bool
) -> tuple[mi.Vector3f, mi.Color3f]:
    """Direction behind a smooth interface whose index is that of band `hero`, and the carrier's weight.

    Reflection is chosen with Fresnel's probability; radiance that passes scales with the index squared.
    """
    index = dr.gather(mi.Float, stage.spectra, row * stage.stride + hero, active)
    reflected, cosine, _, into = mi.fresnel(mi.Frame3f.cos_theta(wi), index)
    mirrors = choice < reflected
    toward = dr.select(mirrors, mi.reflect(wi), mi.refract(wi, cosine, into))
    return toward, dr.select(mirrors, mi.Color3f(1.0), mi.Color3f(*CARRIER) * dr.square(into))


def in_band(throughput: mi.ArrayXf, hero: mi.UInt32, chosen: mi.Bool) -> mi.ArrayXf:
    """Where `chosen`, all of a path's light in one band: its throughput times the number of bands."""
    bands = len(throughput)
    return mi.ArrayXf(
        [
            dr.select(chosen, dr.select(hero == band, throughput[band] * bands, 0.0), throughput[band])
            for band in range(bands)
        ]
    )


def light(stage: Stage, emitter: mi.EmitterPtr, direction: mi.Vector3f, active: mi.Bool) -> mi.ArrayXf:
    """Radiance of a light towards -direction, [band, lane]."""
    row = dr.gather(mi.UInt32, stage.light_of, dr.reinterpret_array(mi.UInt32, emitter), active)
    fields = dr.gather(mi.ArrayXu, stage.lights, row, active, shape=(FIELDS, dr.width(row)))
    coefficients = [mi.Float(1.0)]
    if stage.has_sky_image:
        sky = active & (fields[WIDTH] > 0)
        uv = mi.Point2f(
            0.5 + dr.atan2(direction.x, direction.z) * dr.inv_two_pi,
            1 - dr.safe_acos(direction.y) * dr.inv_pi,
        )
        texel = texel_at(stage, fields, uv, mi.Bool(True), mi.Bool(False), sky)
        coefficients = [dr.select(sky, texel[j], 1.0 if j == 0 else 0.0) for j in range(ROWS)]
    if stage.few_lights is not None:
        radiance = mixed_constants(stage.few_lights, stage.bands, fields[BASIS], coefficients, active)
    elif stage.has_sky_image:
        radiance = mixed(stage, fields[BASIS], coefficients, active)
    else:
        return spectrum(stage, fields[BASIS], active)
    # A picture may reach below 0 in some band where its coefficients come from colours
    return dr.maximum(radiance, 0.0) if stage.has_sky_image else radiance


def mixed_constants(
    lights: FewLights, bands: int, row: mi.UInt32, coefficients: list[mi.Float], active: mi.Bool
) -> mi.ArrayXf:
    """As `mixed`, of the spectra that are constants of the kernel; the same bits."""
    total = [mi.Float(0.0)] * bands
    for base, rows in lights:
        here = active & (row == base)
        for values, coefficient in zip(rows, coefficients, strict=False):
            share = dr.select(here, coefficient, 0.0)
            total = [dr.fma(value, share, before) for value, before in zip(values, total, strict=True)]
    return mi.ArrayXf(total)


def texel_at(
    stage: Stage, fields: mi.ArrayXu, uv: mi.Point2f, wrap_u: mi.Bool, wrap_v: mi.Bool, active: mi.Bool
) -> mi.Vector4f:
    """Bilinear lookup; v = 1 is the top row. Outside of the unit square it repeats or stays at the edge."""
    width, height = mi.Float(fields[WIDTH]), mi.Float(fields[HEIGHT])
    u = dr.select(wrap_u, uv.x - dr.floor(uv.x), uv.x)
    v = dr.select(wrap_v, uv.y - dr.floor(uv.y), uv.y)
    x = u * width - 0.5
    y = (1 - v) * height - 0.5
    left, top = dr.floor(x), dr.floor(y)
    fx, fy = x - left, y - top

    def index(place: mi.Float, size: mi.Float, wrap: mi.Bool) -> mi.UInt32:
        around = place - dr.floor(place / size) * size
        return mi.UInt32(dr.clip(dr.select(wrap, around, place), 0, size - 1))

    columns = [index(left + k, width, wrap_u) for k in (0, 1)]
    rows = [index(top + k, height, wrap_v) for k in (0, 1)]

    def texel(row: mi.UInt32, column: mi.UInt32) -> mi.Vector4f:
        return dr.gather(mi.Vector4f, stage.texels, fields[TEXTURE] + row * fields[WIDTH] + column, active)

    upper = dr.lerp(texel(rows[0], columns[0]), texel(rows[0], columns[1]), fx)
    lower = dr.lerp(texel(rows[1], columns[0]), texel(rows[1], columns[1]), fx)
    return dr.lerp(upper, lower, fy)
