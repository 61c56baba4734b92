// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace dsorb::synthetic {

/// One octave of value noise. Different cell sides give texture that stays visible at grazing
/// angles (planks, courses, tyre marks).
struct NoiseLayer {
  float cell_u = 1;     ///< lattice spacing [m]
  float cell_v = 1;     ///< lattice spacing [m]
  float amplitude = 0;  ///< largest deviation [grey levels]
};

/// Grid of rectangles painted over what lies below: windows, bricks, books, floor tiles.
struct TileLayer {
  float period_u = 1;  ///< [m]
  float period_v = 1;  ///< [m]
  float fill_u = 0.5;  ///< share of the period that is painted, (0, 1]
  float fill_v = 0.5;  ///< share of the period that is painted, (0, 1]
  float shift = 0;     ///< offset from one row of tiles to the next [periods]
  float grey = 128;    ///< mean of the tiles [grey levels]
  float spread = 0;    ///< largest random deviation of a tile [grey levels]
};

/// Seeded surface texture, band-limited at the image: whatever is too fine for the pixels that look
/// at it is faded to its mean.
struct Texture {
  std::uint32_t seed = 0;
  float grey = 128;               ///< ground colour [grey levels]
  float crispness = 4;            ///< how much blotches are steepened at most; 1: soft as clouds
  std::vector<TileLayer> tiles;   ///< painted in this order
  std::vector<NoiseLayer> noise;  ///< added on top; coarse to fine
};

/// Surface coordinates [m] of a pixel centre and their change over one pixel [m/px].
struct Footprint {
  float u = 0;
  float v = 0;
  float size_u = 0;
  float size_v = 0;
};

/// Appends `count` octaves of equal amplitude, each half as coarse as the one before.
/// @param coarsest the first octave
void addOctaves(Texture& texture, NoiseLayer coarsest, int count);

/// Grey levels of a texture as pixels see it.
/// @param greys one a pixel [grey levels], within (0, 255)
void sampleTexture(const Texture& texture,
                   const std::vector<Footprint>& at,
                   std::vector<float>& greys);

}  // namespace dsorb::synthetic
