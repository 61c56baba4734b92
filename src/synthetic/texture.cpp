// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/texture.h"

#include "base/lanes.h"
#include "base/target_clones.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace dsorb::synthetic {
namespace {

// A noise cell is invisible below the first and at full contrast above the second size [px]: the
// shortest cells that count are then 5 to 9 px, which bilinear interpolation reproduces well, and
// detail appears slowly when the camera comes nearer.
constexpr float kFadedCell = 3.0F;
constexpr float kFullCell = 9.0F;
// Noise cells above this size are steepened [px].
constexpr float kOutlineCell = 5.0F;
// Width of the box filter over painted edges [px]: about the blur of a sharp lens.
constexpr float kEdgeWidth = 2.6F;
// Greys are squeezed softly into [kDarkest, kBrightest] from kKnee grey levels inside.
constexpr float kDarkest = 6.0F;
constexpr float kBrightest = 244.0F;
constexpr float kKnee = 40.0F;

using Ints = std::int32_t __attribute__((vector_size(sizeof(Lanes))));
using Hashes = std::uint32_t __attribute__((vector_size(sizeof(Lanes))));

DSORB_ALWAYS_INLINE Lanes clamp(const Lanes& x, float low, float high) {
  const Lanes raised = x < low ? spread<Lanes>(low) : x;
  return raised > high ? spread<Lanes>(high) : raised;
}

/// Contrast left of detail whose cells have this size [px].
DSORB_ALWAYS_INLINE Lanes visibility(const Lanes& cell) {
  const Lanes t = clamp((cell - kFadedCell) / (kFullCell - kFadedCell), 0, 1);
  return t * t * (3.0F - 2.0F * t);
}

DSORB_ALWAYS_INLINE Ints floorToInt(const Lanes& x) {
  const Ints i = __builtin_convertvector(x, Ints);
  return i + (x < __builtin_convertvector(i, Lanes));
}

/// Uniform in [-1, 1), a function of lattice point and seed alone.
/// @source integer finaliser of the murmur kind; constants by C. Wellons, "hash-prospector"
DSORB_ALWAYS_INLINE Lanes latticeValue(const Ints& x, const Ints& y, std::uint32_t seed) {
  Hashes h = (Hashes)x * 0x9E3779B1U + (Hashes)y * 0x85EBCA77U;
  h ^= seed;
  h ^= h >> 15U;
  h *= 0x2C1B3C6DU;
  h ^= h >> 12U;
  h *= 0x297A2D39U;
  h ^= h >> 15U;
  return __builtin_convertvector((Ints)h, Lanes) * 0x1.0p-31F;
}

/// Value noise in [-1, 1]: lattice values joined by cubic steps.
DSORB_ALWAYS_INLINE Lanes valueNoise(const Lanes& x, const Lanes& y, std::uint32_t seed) {
  const Ints ix = floorToInt(x);
  const Ints iy = floorToInt(y);
  const Lanes fx = x - __builtin_convertvector(ix, Lanes);
  const Lanes fy = y - __builtin_convertvector(iy, Lanes);
  const Lanes sx = fx * fx * (3.0F - 2.0F * fx);
  const Lanes sy = fy * fy * (3.0F - 2.0F * fy);
  const Lanes v00 = latticeValue(ix, iy, seed);
  const Lanes v10 = latticeValue(ix, iy + 1, seed);
  const Lanes top = v00 + sx * (latticeValue(ix + 1, iy, seed) - v00);
  const Lanes bottom = v10 + sx * (latticeValue(ix + 1, iy + 1, seed) - v10);
  return top + sy * (bottom - top);
}

/// Integral of a pulse train of period 1, pulses centred at 0.5.
/// @param fill pulse width
DSORB_ALWAYS_INLINE Lanes pulseIntegral(const Lanes& at, float fill) {
  const Lanes whole = __builtin_convertvector(floorToInt(at), Lanes);
  return whole * fill + clamp(at - whole - 0.5F * (1.0F - fill), 0, fill);
}

/// Painted share of a pixel in one direction: pulse train under a box filter.
/// @param x position [periods]; @param fill pulse width; @param width filter
DSORB_ALWAYS_INLINE Lanes pulseCoverage(const Lanes& x, float fill, const Lanes& width) {
  if (fill >= 1.0F) return spread<Lanes>(1.0F);
  return (pulseIntegral(x + 0.5F * width, fill) - pulseIntegral(x - 0.5F * width, fill)) / width;
}

/// Position in a train of unit cells: the cell, its neighbour across the nearer border, and the
/// neighbour's share when the border is softened to `width`.
struct CellBlend {
  Ints cell;
  Ints neighbour;
  Lanes share;
};

DSORB_ALWAYS_INLINE CellBlend blendCells(const Lanes& x, const Lanes& width) {
  const Ints cell = floorToInt(x);
  const Lanes offset = x - __builtin_convertvector(cell, Lanes) - 0.5F;
  const Lanes from_middle = offset < 0.0F ? -offset : offset;
  return {cell,
          offset < 0.0F ? cell - 1 : cell + 1,
          clamp(0.5F - (0.5F - from_middle) / width, 0, 0.5F)};
}

/// Painted share and random deviation in one row of tiles.
struct TileRow {
  Lanes coverage;
  Lanes deviation;
};

DSORB_ALWAYS_INLINE TileRow sampleRow(const TileLayer& layer,
                                      const Lanes& x,
                                      const Lanes& width,
                                      const Ints& row) {
  constexpr std::uint32_t kSeed = 0x51ED27U;
  const Lanes shifted = x + layer.shift * __builtin_convertvector(row & 1, Lanes);
  TileRow out{pulseCoverage(shifted, layer.fill_u, width), {}};
  if (!(layer.spread > 0)) return out;
  const CellBlend blend = blendCells(shifted, width);
  out.deviation = latticeValue(blend.cell, row, kSeed);
  if (!inAnyLane(blend.share > 0.0F)) return out;
  out.deviation += blend.share * (latticeValue(blend.neighbour, row, kSeed) - out.deviation);
  return out;
}

/// Surface coordinates of several pixels and their change over one pixel.
struct Footprints {
  Lanes u;
  Lanes v;
  Lanes size_u;
  Lanes size_v;
};

/// Paints the tiles over a grey level.
DSORB_ALWAYS_INLINE void paintTiles(const TileLayer& layer,
                                    const Footprints& at,
                                    const Lanes& offset,
                                    Lanes& grey) {
  constexpr float kLargest = std::numeric_limits<float>::max();
  const Lanes width_u = clamp(kEdgeWidth * at.size_u / layer.period_u, 1e-4F, kLargest);
  const Lanes width_v = clamp(kEdgeWidth * at.size_v / layer.period_v, 1e-4F, kLargest);
  const Lanes visible_u = visibility(layer.period_u / at.size_u);
  const Lanes visible_v = visibility(layer.period_v / at.size_v);
  const Lanes x = at.u / layer.period_u + offset;
  const Lanes y = at.v / layer.period_v + offset;
  const CellBlend rows = blendCells(y, width_v);
  TileRow row = sampleRow(layer, x, width_u, rows.cell);
  if (inAnyLane(rows.share > 0.0F)) {
    const TileRow next = sampleRow(layer, x, width_u, rows.neighbour);
    row.coverage += rows.share * (next.coverage - row.coverage);
    row.deviation += rows.share * (next.deviation - row.deviation);
  }
  const Lanes coverage_v = pulseCoverage(y, layer.fill_v, width_v);
  const Lanes coverage = (layer.fill_u + visible_u * (row.coverage - layer.fill_u)) *
                         (layer.fill_v + visible_v * (coverage_v - layer.fill_v));
  const Lanes tile = layer.grey + layer.spread * visible_u * visible_v * row.deviation;
  grey += coverage * (tile - grey);
}

/// Steepens noise of large cells, so that blotches have outlines that stay a few pixels wide from
/// near and far, as a lens shows them.
/// @param cell [px]
DSORB_ALWAYS_INLINE Lanes outlined(const Lanes& noise, const Lanes& cell, float crispness) {
  const Lanes bounded = clamp(clamp(cell / kOutlineCell, 1, crispness) * noise, -1, 1);
  return bounded * (1.5F - 0.5F * bounded * bounded);
}

/// Adds the octaves of noise; those too fine for all of the pixels cost nothing.
DSORB_ALWAYS_INLINE void addNoise(const Texture& texture,
                                  const Footprints& at,
                                  const Lanes& offset,
                                  Lanes& grey) {
  std::uint32_t seed = texture.seed;
  for (const NoiseLayer& layer : texture.noise) {
    seed += 0x9E3779B9U;
    const Lanes cell_u = layer.cell_u / at.size_u;
    const Lanes cell_v = layer.cell_v / at.size_v;
    const Lanes cell = cell_v < cell_u ? cell_v : cell_u;
    const LaneMask shown = cell > kFadedCell;
    if (!inAnyLane(shown)) continue;
    const Lanes noise =
        valueNoise(at.u / layer.cell_u + offset, at.v / layer.cell_v + offset, seed);
    const Lanes steep = outlined(noise, cell, texture.crispness);
    grey = shown ? grey + layer.amplitude * visibility(cell) * steep : grey;
  }
}

/// One member of kLanes footprints.
DSORB_ALWAYS_INLINE Lanes gather(const Footprint* at, float Footprint::*member) {
  float values[kLanes];
  for (int k = 0; k < kLanes; ++k) values[k] = at[k].*member;
  return load(values);
}

/// @param at    of kLanes pixels
/// @param greys kLanes of them
DSORB_ALWAYS_INLINE void sampleLanes(const Texture& texture, const Footprint* at, float* greys) {
  const Footprints lanes{gather(at, &Footprint::u),
                         gather(at, &Footprint::v),
                         gather(at, &Footprint::size_u),
                         gather(at, &Footprint::size_v)};
  // Moves the grid of every texture elsewhere, so that equal layers do not line up.
  const Lanes offset = 1.0F + latticeValue(Ints{} + 17, Ints{} + 29, texture.seed);
  auto grey = spread<Lanes>(texture.grey);
  for (const TileLayer& layer : texture.tiles) paintTiles(layer, lanes, offset, grey);
  addNoise(texture, lanes, offset, grey);
  store(grey, greys);
}

/// Keeps greys away from black and white without a kink.
float squeeze(float grey) {
  if (grey < kDarkest + kKnee) {
    return kDarkest + kKnee * std::exp((grey - kDarkest - kKnee) / kKnee);
  }
  if (grey > kBrightest - kKnee) {
    return kBrightest - kKnee * std::exp((kBrightest - kKnee - grey) / kKnee);
  }
  return grey;
}

}  // namespace

void addOctaves(Texture& texture, NoiseLayer coarsest, int count) {
  for (int octave = 0; octave < count; ++octave) {
    texture.noise.push_back(coarsest);
    coarsest.cell_u *= 0.5F;
    coarsest.cell_v *= 0.5F;
  }
}

DSORB_TARGET_CLONES void sampleTexture(const Texture& texture,
                                       const std::vector<Footprint>& at,
                                       std::vector<float>& greys) {
  greys.resize(at.size());
  std::size_t begin = 0;
  for (; begin + kLanes <= at.size(); begin += kLanes) {
    sampleLanes(texture, &at[begin], &greys[begin]);
  }
  if (begin < at.size()) {
    Footprint last[kLanes];
    float sampled[kLanes];
    for (std::size_t k = 0; k < kLanes; ++k) last[k] = at[std::min(begin + k, at.size() - 1)];
    sampleLanes(texture, last, sampled);
    std::copy_n(sampled, at.size() - begin, &greys[begin]);
  }
  for (float& grey : greys) grey = squeeze(grey);
}

}  // namespace dsorb::synthetic
