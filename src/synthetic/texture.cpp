// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/texture.h"

#include <algorithm>
#include <cmath>

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

float smoothStep(float x) {
  const float t = std::clamp(x, 0.0F, 1.0F);
  return t * t * (3.0F - 2.0F * t);
}

/// Contrast left of detail whose cells have this size [px].
float visibility(float cell) {
  return smoothStep((cell - kFadedCell) / (kFullCell - kFadedCell));
}

int floorToInt(float x) {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(x < static_cast<float>(i));
}

/// Uniform in [-1, 1), a function of lattice point and seed alone.
/// @source integer finaliser of the murmur kind; constants by C. Wellons, "hash-prospector"
float latticeValue(int x, int y, std::uint32_t seed) {
  std::uint32_t h =
      static_cast<std::uint32_t>(x) * 0x9E3779B1U + static_cast<std::uint32_t>(y) * 0x85EBCA77U;
  h ^= seed;
  h ^= h >> 15U;
  h *= 0x2C1B3C6DU;
  h ^= h >> 12U;
  h *= 0x297A2D39U;
  h ^= h >> 15U;
  return static_cast<float>(static_cast<std::int32_t>(h)) * 0x1.0p-31F;
}

/// Value noise in [-1, 1]: lattice values joined by cubic steps.
float valueNoise(float x, float y, std::uint32_t seed) {
  const int ix = floorToInt(x);
  const int iy = floorToInt(y);
  const float fx = x - static_cast<float>(ix);
  const float fy = y - static_cast<float>(iy);
  const float sx = fx * fx * (3.0F - 2.0F * fx);
  const float sy = fy * fy * (3.0F - 2.0F * fy);
  const float v00 = latticeValue(ix, iy, seed);
  const float v01 = latticeValue(ix + 1, iy, seed);
  const float v10 = latticeValue(ix, iy + 1, seed);
  const float v11 = latticeValue(ix + 1, iy + 1, seed);
  const float top = v00 + sx * (v01 - v00);
  const float bottom = v10 + sx * (v11 - v10);
  return top + sy * (bottom - top);
}

/// Painted share of a pixel in one direction: pulse train of period 1 under a box filter.
/// @param x position [periods], pulses centred at 0.5; @param fill pulse width; @param width filter
float pulseCoverage(float x, float fill, float width) {
  if (fill >= 1.0F) return 1.0F;
  const float start = 0.5F * (1.0F - fill);
  const auto integral = [&](float at) {
    const auto whole = static_cast<float>(floorToInt(at));
    return whole * fill + std::clamp(at - whole - start, 0.0F, fill);
  };
  return (integral(x + 0.5F * width) - integral(x - 0.5F * width)) / width;
}

/// Position in a train of unit cells: the cell, its neighbour across the nearer border, and the
/// neighbour's share when the border is softened to `width`.
struct CellBlend {
  int cell;
  int neighbour;
  float share;
};

CellBlend blendCells(float x, float width) {
  const int cell = floorToInt(x);
  const float offset = x - static_cast<float>(cell) - 0.5F;
  const float to_border = 0.5F - std::abs(offset);
  return {cell, offset < 0 ? cell - 1 : cell + 1, std::max(0.0F, 0.5F - to_border / width)};
}

/// Painted share and random deviation in one row of tiles.
struct TileRow {
  float coverage;
  float deviation;
};

TileRow sampleRow(const TileLayer& layer, float x, float width, int row) {
  const std::uint32_t seed = 0x51ED27U;
  const float shifted = x + layer.shift * static_cast<float>(row & 1);
  TileRow result{pulseCoverage(shifted, layer.fill_u, width), 0};
  if (layer.spread > 0) {
    const CellBlend blend = blendCells(shifted, width);
    result.deviation = latticeValue(blend.cell, row, seed);
    if (blend.share > 0) {
      result.deviation +=
          blend.share * (latticeValue(blend.neighbour, row, seed) - result.deviation);
    }
  }
  return result;
}

/// Paints the tiles over a grey level.
float paintTiles(const TileLayer& layer, const Footprint& at, float offset, float below) {
  const float width_u = std::max(kEdgeWidth * at.size_u / layer.period_u, 1e-4F);
  const float width_v = std::max(kEdgeWidth * at.size_v / layer.period_v, 1e-4F);
  const float visible_u = visibility(layer.period_u / at.size_u);
  const float visible_v = visibility(layer.period_v / at.size_v);
  const float x = at.u / layer.period_u + offset;
  const float y = at.v / layer.period_v + offset;
  const CellBlend rows = blendCells(y, width_v);
  TileRow row = sampleRow(layer, x, width_u, rows.cell);
  if (rows.share > 0) {
    const TileRow next = sampleRow(layer, x, width_u, rows.neighbour);
    row.coverage += rows.share * (next.coverage - row.coverage);
    row.deviation += rows.share * (next.deviation - row.deviation);
  }
  const float coverage_v = pulseCoverage(y, layer.fill_v, width_v);
  const float coverage = (layer.fill_u + visible_u * (row.coverage - layer.fill_u)) *
                         (layer.fill_v + visible_v * (coverage_v - layer.fill_v));
  const float grey = layer.grey + layer.spread * visible_u * visible_v * row.deviation;
  return below + coverage * (grey - below);
}

/// Steepens noise of large cells, so that blotches have outlines that stay a few pixels wide from
/// near and far, as a lens shows them.
/// @param cell [px]
float outline(float noise, float cell, float crispness) {
  const float steep = std::clamp(cell / kOutlineCell, 1.0F, crispness) * noise;
  const float bounded = std::clamp(steep, -1.0F, 1.0F);
  return bounded * (1.5F - 0.5F * bounded * bounded);
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

float sampleTexture(const Texture& texture, const Footprint& at) {
  // Moves the grid of every texture elsewhere, so that equal layers do not line up.
  const float offset = latticeValue(17, 29, texture.seed) + 1.0F;
  float grey = texture.grey;
  for (const TileLayer& layer : texture.tiles) grey = paintTiles(layer, at, offset, grey);
  std::uint32_t seed = texture.seed;
  for (const NoiseLayer& layer : texture.noise) {
    seed += 0x9E3779B9U;
    const float cell = std::min(layer.cell_u / at.size_u, layer.cell_v / at.size_v);
    if (cell <= kFadedCell) continue;
    const float noise =
        valueNoise(at.u / layer.cell_u + offset, at.v / layer.cell_v + offset, seed);
    grey += layer.amplitude * visibility(cell) * outline(noise, cell, texture.crispness);
  }
  return squeeze(grey);
}

}  // namespace dsorb::synthetic
