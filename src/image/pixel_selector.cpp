// SPDX-License-Identifier: BSD-3-Clause
#include "image/pixel_selector.h"

#include "base/parallel.h"
#include "base/random.h"
#include "image/photometric.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr double kAboveMedian = 7;        // [grey levels / px]; DSO, section 3.2
constexpr int kGradientBins = 49;         // of 1 grey level / px; the last one takes the rest
constexpr std::size_t kRowGrain = 16;     // rows one thread takes at a time
constexpr std::size_t kRegionGrain = 16;  // regions one thread takes at a time

constexpr float kScaleFactor1 = 0.75F;      // threshold factor of level 1; DSO as published
constexpr float kScaleFactor2 = 0.421875F;  // of level 2: 0.75 cubed; DSO as published

/// Pixels of a row that belong to one region.
struct Run {
  int y;
  int begin;
  int end;
};

/// Squared gradients of the rows of levels 1 and 2 that show a row of the image.
class CoarseGradients {
 public:
  explicit CoarseGradients(const Frame& frame) : frame_(frame) {
    rows_.resize(static_cast<std::size_t>(std::min(frame.pyramid().levels(), kLevels) - 1));
    for (int level = 1; has(level); ++level) {
      row(level).squared.resize(static_cast<std::size_t>(frame.level(level).width()));
    }
  }
  void moveTo(int y) {
    for (int level = 1; has(level); ++level) {
      Row& kept = row(level);
      if (kept.y == y >> level) continue;
      kept.y = y >> level;
      squareGradients(frame_.level(level), kept.y, frame_.responseSlope(), kept.squared.data());
    }
  }
  [[nodiscard]] bool has(int level) const {
    return static_cast<std::size_t>(level) <= rows_.size();
  }
  [[nodiscard]] const float* at(int level) const {
    return rows_[static_cast<std::size_t>(level) - 1].squared.data();
  }

 private:
  static constexpr int kLevels = 3;  // of the pyramid that make scales
  struct Row {
    int y = -1;
    std::vector<float> squared;
  };
  Row& row(int level) { return rows_[static_cast<std::size_t>(level) - 1]; }

  const Frame& frame_;
  std::vector<Row> rows_;
};

/// Adds the scale of a level. Its pixels end where runs do: sides of a frame that has the level,
/// and of regions, are multiples of the scale.
template <int kLevel>
void addLevel(const float* squared, const Run& run, float threshold, std::uint8_t* scales) {
  constexpr int kScale = 1 << kLevel;
  for (int x = run.begin; x < run.end; x += kScale) {
    if (!(squared[x >> kLevel] > threshold)) continue;
    for (int i = 0; i < kScale; ++i) {
      scales[x + i] = static_cast<std::uint8_t>(scales[x + i] + kScale);
    }
  }
}

void fillRow(const RegionThresholds& thresholds,
             const CoarseGradients& coarse,
             float factor,
             const Run& row,
             std::uint8_t* scales) {
  constexpr int kSide = RegionThresholds::kRegionSize;
  const float* squared = thresholds.squaredGradients(row.y);
  for (int begin = row.begin; begin < row.end; begin += kSide) {
    const Run run{row.y, begin, std::min(begin + kSide, row.end)};
    const float threshold = factor * thresholds.squaredThreshold(begin, row.y);
    for (int x = run.begin; x < run.end; ++x) scales[x] = squared[x] > threshold ? 1 : 0;
    if (coarse.has(1)) addLevel<1>(coarse.at(1), run, kScaleFactor1 * threshold, scales);
    if (coarse.has(2)) addLevel<2>(coarse.at(2), run, kScaleFactor2 * threshold, scales);
  }
}

constexpr std::size_t kPatchRowGrain = 8;  // rows of patches one thread takes at a time

// Pixels this near to the edge are not looked at. @source DSO as published
constexpr int kMarginLow = 4;
constexpr int kMarginRight = 5;
constexpr int kMarginBottom = 3;

/// Strongest pixel of a block so far.
struct Best {
  float score = 0;
  int x = -1;
  int y = -1;
  bool closed = false;  ///< a finer scale has a pixel here

  void offer(float new_score, int new_x, int new_y) {
    if (new_score > score) {
      score = new_score;
      x = new_x;
      y = new_y;
    }
  }
  void close() {
    closed = true;
    x = -1;
  }
};

struct Direction {
  float x;
  float y;
};

std::array<Direction, 16> makeDirections() {
  std::array<Direction, 16> directions{};
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const double angle = M_PI * static_cast<double>(i) / static_cast<double>(directions.size());
    directions[i] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
  }
  return directions;
}

/// One pass over the image with a given block size.
class BlockPass {
 public:
  BlockPass(const Frame& frame,
            const ScaleMap& scales,
            const std::vector<std::uint8_t>& random_bytes)
      : frame_(frame), scales_(scales), random_bytes_(random_bytes) {}

  void run(int block_size, std::vector<SelectedPixel>& selected) {
    selected.clear();
    selected_ = &selected;
    fine_count_ = 0;
    size_ = block_size;
    for (int y = 0; y < frame_.height(); y += 4 * size_) {
      for (int x = 0; x < frame_.width(); x += 4 * size_) {
        coarseBlock(x, y);
      }
    }
  }

 private:
  struct Scale {
    Best best;
    Direction direction;
  };
  struct Block {
    int left;
    int top;
    int right;
    int bottom;
  };

  [[nodiscard]] Scale open() const {
    return {{}, directions_[random_bytes_[fine_count_ % random_bytes_.size()] & 15U]};
  }

  void coarseBlock(int x0, int y0) {
    Scale coarse = open();
    for (int y = y0; y < std::min(y0 + 4 * size_, frame_.height()); y += 2 * size_) {
      for (int x = x0; x < std::min(x0 + 4 * size_, frame_.width()); x += 2 * size_) {
        mediumBlock(x, y, coarse);
      }
    }
    keep(coarse.best, 4);
  }

  void mediumBlock(int x0, int y0, Scale& coarse) {
    Scale medium = open();
    for (int y = y0; y < std::min(y0 + 2 * size_, frame_.height()); y += size_) {
      for (int x = x0; x < std::min(x0 + 2 * size_, frame_.width()); x += size_) {
        fineBlock(x, y, medium, coarse);
      }
    }
    keep(medium.best, 2);
  }

  /// What a finer scale has found closes the coarser ones.
  void fineBlock(int x0, int y0, Scale& medium, Scale& coarse) {
    const Block block{std::max(x0, kMarginLow),
                      std::max(y0, kMarginLow),
                      std::min(x0 + size_, frame_.width() - kMarginRight),
                      std::min(y0 + size_, frame_.height() - kMarginBottom)};
    Scale fine = open();
    offer(block, 1, fine);
    if (fine.best.x >= 0) {
      ++fine_count_;
      keep(fine.best, 1);
      medium.best.close();
      coarse.best.close();
      return;
    }
    if (!medium.best.closed) {
      offer(block, 2, medium);
      if (medium.best.x >= 0) coarse.best.close();
    }
    if (!coarse.best.closed) offer(block, 4, coarse);
  }

  /// Offers all pixels of a block that qualify at a scale.
  void offer(const Block& block, std::uint8_t type, Scale& scale) const {
    constexpr int kStep = 8;  // pixels that are passed over at once
    const std::uint64_t wanted = 0x0101010101010101U * type;
    for (int y = block.top; y < block.bottom; ++y) {
      const std::uint8_t* scales = scales_.row(y);
      const auto offer_until = [&](int x, int end) {
        for (; x < end; ++x) {
          if ((scales[x] & type) != 0) offerPixel(x, y, scale);
        }
      };
      int x = block.left;
      for (; x + kStep <= block.right; x += kStep) {
        std::uint64_t eight = 0;
        std::memcpy(&eight, scales + x, sizeof(eight));
        if ((eight & wanted) != 0) offer_until(x, x + kStep);
      }
      offer_until(x, block.right);
    }
  }

  void offerPixel(int x, int y, Scale& scale) const {
    const ImageSample sample = frame_.level(0).at(x, y);
    const Direction& direction = scale.direction;
    scale.best.offer(std::abs(sample.dx * direction.x + sample.dy * direction.y), x, y);
  }

  void keep(const Best& best, int type) {
    if (best.x >= 0) {
      selected_->push_back({best.x, best.y, type});
    }
  }

  const Frame& frame_;
  const ScaleMap& scales_;
  const std::vector<std::uint8_t>& random_bytes_;
  const std::array<Direction, 16> directions_ = makeDirections();
  std::vector<SelectedPixel>* selected_ = nullptr;
  std::size_t fine_count_ = 0;
  int size_ = 1;
};

/// Drops pixels at random so that about `share` of them stays.
void thin(std::vector<SelectedPixel>& selected,
          double share,
          const std::vector<std::uint8_t>& random_bytes) {
  const auto limit = static_cast<int>(255.0 * share);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < selected.size(); ++i) {
    if (random_bytes[i % random_bytes.size()] <= limit) {
      selected[kept++] = selected[i];
    }
  }
  selected.resize(kept);
}

struct Cell {
  int x = 0;  // of the top left pixel
  int y = 0;
  int size = 1;
};

/// Marks the strongest pixels of one cell. @param out gets each pixel once
void cellMaxima(const PyramidLevel& level,
                const Cell& cell,
                float squared_threshold,
                std::vector<SelectedPixel>& out) {
  std::array<Best, 4> best;
  for (int y = cell.y; y < cell.y + cell.size; ++y) {
    for (int x = cell.x; x < cell.x + cell.size; ++x) {
      const auto [intensity, dx, dy] = level.at(x, y);
      if (dx * dx + dy * dy > squared_threshold) {
        best[0].offer(std::abs(dx), x, y);
        best[1].offer(std::abs(dy), x, y);
        best[2].offer(std::abs(dx - dy), x, y);
        best[3].offer(std::abs(dx + dy), x, y);
      }
    }
  }
  const std::size_t first = out.size();
  for (const Best& candidate : best) {
    const auto same = [&](const SelectedPixel& p) {
      return p.x == candidate.x && p.y == candidate.y;
    };
    if (candidate.x >= 0 &&
        std::none_of(out.begin() + static_cast<std::ptrdiff_t>(first), out.end(), same)) {
      out.push_back({candidate.x, candidate.y, 1});
    }
  }
}

}  // namespace

void squareGradients(const PyramidLevel& level, int y, const ResponseSlope* slope, float* squared) {
  const int width = level.width();
  std::fill(squared, squared + width, 0.0F);
  if (y == 0 || y == level.height() - 1) return;
  const float* here = level.row(y);
  const float* above = here - width;
  const float* below = here + width;
  for (int x = 1; x < width - 1; ++x) {
    const float dx = 0.5F * (here[x + 1] - here[x - 1]);
    const float dy = 0.5F * (below[x] - above[x]);
    const float value = dx * dx + dy * dy;
    const bool valid = value + here[x] == value + here[x];  // no NaN
    squared[x] = valid ? value : 0.0F;
  }
  if (slope == nullptr) return;
  for (int x = 1; x < width - 1; ++x) {
    if (squared[x] == 0) continue;
    // The response is not known well at its ends. @source DSO as published
    const float grey = std::clamp(here[x] + 0.5F, 5.0F, 250.0F);
    const float factor = (*slope)[static_cast<std::size_t>(grey)];
    squared[x] = squared[x] * factor * factor;
  }
}

void RegionThresholds::resize(int width, int height) {
  width_ = width;
  regions_x_ = std::max(1, width / kRegionSize);
  regions_y_ = std::max(1, height / kRegionSize);
  squared_gradients_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  thresholds_.resize(static_cast<std::size_t>(regions_x_) * static_cast<std::size_t>(regions_y_));
  squared_thresholds_.resize(thresholds_.size());
}

void RegionThresholds::compute(const Frame& frame) {
  const PyramidLevel& level = frame.level(0);
  resize(level.width(), level.height());
  const ResponseSlope* slope = frame.responseSlope();
  const auto rows = static_cast<std::size_t>(level.height());
  forEachRange(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      squareGradients(
          level, y, slope, squared_gradients_.data() + static_cast<std::ptrdiff_t>(y) * width_);
    }
  });
  medianGradients(level);
  smoothAndSquare();
}

void RegionThresholds::medianGradients(const PyramidLevel& level) {
  forEachRange(thresholds_.size(), kRegionGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t region = begin; region < end; ++region) {
      thresholds_[region] =
          static_cast<float>(medianGradient(level, static_cast<int>(region)) + kAboveMedian);
    }
  });
}

int RegionThresholds::medianGradient(const PyramidLevel& level, int region) const {
  const int left = region % regions_x_ * kRegionSize;
  const int top = region / regions_x_ * kRegionSize;
  const int begin_x = std::max(left, 1);
  const int width = std::min(left + kRegionSize, level.width() - 1) - begin_x;
  const int end_y = std::min(top + kRegionSize, level.height() - 1);
  std::array<int, kGradientBins> histogram{};
  std::array<int, kRegionSize> bins{};
  int count = 0;
  for (int y = std::max(top, 1); y < end_y; ++y) {
    const float* squared = squaredGradients(y) + begin_x;
    const float* row = level.row(y) + begin_x;
    for (int i = 0; i < width; ++i) {  // apart from the counting: several at once
      bins[static_cast<std::size_t>(i)] =
          static_cast<int>(std::min(std::sqrt(squared[i]), kGradientBins - 1.0F));
    }
    for (int i = 0; i < width; ++i) {
      const int valid = std::isfinite(row[i]) ? 1 : 0;
      histogram[static_cast<std::size_t>(bins[static_cast<std::size_t>(i)])] += valid;
      count += valid;
    }
  }
  const int half = (count + 1) / 2;
  int bin = 0;
  for (int sum = histogram[0]; sum <= half && bin < kGradientBins - 1;) {
    sum += histogram[static_cast<std::size_t>(++bin)];
  }
  return count > 0 ? bin : 0;
}

void RegionThresholds::smoothAndSquare() {
  for (int y = 0; y < regions_y_; ++y) {
    for (int x = 0; x < regions_x_; ++x) {
      float sum = 0;
      int count = 0;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, regions_y_ - 1); ++v) {
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, regions_x_ - 1); ++u) {
          sum += thresholds_[index(u, v)];
          ++count;
        }
      }
      const float mean = sum / static_cast<float>(count);
      squared_thresholds_[index(x, y)] = mean * mean;
    }
  }
}

void ScaleMap::resize(int width, int height) {
  width_ = width;
  scales_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
}

void ScaleMap::compute(const Frame& frame,
                       const RegionThresholds& thresholds,
                       float threshold_factor) {
  resize(frame.width(), frame.height());
  const auto height = static_cast<std::size_t>(frame.height());
  forEachRange(height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    CoarseGradients coarse(frame);
    for (auto y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      coarse.moveTo(y);
      fillRow(thresholds,
              coarse,
              threshold_factor,
              {y, 0, width_},
              scales_.data() + static_cast<std::ptrdiff_t>(y) * width_);
    }
  });
}

bool patternIsValid(const PyramidLevel& level, int x, int y) {
  if (x < kPatternRadius || y < kPatternRadius || x >= level.width() - kPatternRadius ||
      y >= level.height() - kPatternRadius) {
    return false;
  }
  return std::all_of(kPattern.begin(), kPattern.end(), [&](const PatternOffset& offset) {
    return std::isfinite(level.intensity(x + offset.x, y + offset.y));
  });
}

PixelSelector::PixelSelector(int width, int height, const PixelSelectorOptions& options)
    : options_(options),
      width_(width),
      height_(height),
      block_size_(options.first_block_size),
      random_bytes_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  thresholds_.resize(width, height);
  scales_.resize(width, height);
  Random random(static_cast<std::uint64_t>(options.seed));
  std::generate(random_bytes_.begin(), random_bytes_.end(), [&]() {
    return static_cast<std::uint8_t>(random.below(256));
  });
}

std::vector<SelectedPixel> PixelSelector::select(const Frame& frame,
                                                 int wanted,
                                                 float threshold_factor) {
  if (frame.width() != width_ || frame.height() != height_) {
    throw std::invalid_argument(
        "pixel selector of " + std::to_string(width_) + "x" + std::to_string(height_) +
        " got a frame of " + std::to_string(frame.width()) + "x" + std::to_string(frame.height()));
  }
  wanted = std::max(wanted, 1);
  constexpr double kTooFew = 1.25;  // wanted / found. @source of both limits: DSO as published
  constexpr double kTooMany = 0.25;
  constexpr double kThin = 0.95;
  thresholds_.compute(frame);
  scales_.compute(frame, thresholds_, threshold_factor);
  BlockPass pass(frame, scales_, random_bytes_);
  std::vector<SelectedPixel> selected;
  int smallest_too_few = std::numeric_limits<int>::max();
  for (int left = options_.max_repetitions;; --left) {
    pass.run(block_size_, selected);
    const auto found = static_cast<double>(selected.size());
    const double ratio = wanted / std::max(found, 0.5);
    // The count is about proportional to 1 / (size + 1)^2.
    int ideal = std::max(1, static_cast<int>(std::sqrt(found / wanted) * (block_size_ + 1) - 1));
    const bool too_few = ratio > kTooFew && block_size_ > 1;
    if (too_few) {
      smallest_too_few = std::min(smallest_too_few, block_size_);
      ideal = std::min(ideal, block_size_ - 1);
    }
    const bool too_many = ratio < kTooMany && block_size_ + 1 < smallest_too_few;
    if (too_many) {
      ideal = std::clamp(ideal, block_size_ + 1, smallest_too_few - 1);
    }
    if (left > 0 && (too_few || too_many)) {
      block_size_ = ideal;
      continue;
    }
    if (ratio < kThin) {
      thin(selected, ratio, random_bytes_);
    }
    block_size_ = ideal;
    return selected;
  }
}

GridSelection selectGridMaxima(const PyramidLevel& level, int wanted, int spacing) {
  constexpr int kRepetitions = 5;       // @source of this and the next: DSO as published
  constexpr float kMinGradient = 7.5F;  // [grey levels / px]
  GridSelection result;
  result.spacing = std::max(1, spacing);
  float factor = 1;
  for (int left = kRepetitions;; --left) {
    const int used = result.spacing;
    const float squared_threshold = kMinGradient * factor * kMinGradient * factor;
    result.pixels.clear();
    for (int y = 1; y < level.height() - used; y += used) {
      for (int x = 1; x < level.width() - used; x += used) {
        cellMaxima(level, {x, y, used}, squared_threshold, result.pixels);
      }
    }
    const double ratio = static_cast<double>(result.pixels.size()) / wanted;
    result.spacing = std::max(1, static_cast<int>(used * std::sqrt(ratio) + 0.7));
    const bool lower_threshold = used == 1 && result.spacing == 1 && factor == 1.0F;
    if (lower_threshold) {
      factor = 0.5F;
    }
    const bool unchanged = result.spacing == used && !lower_threshold;
    if (unchanged || (ratio > 0.8 && ratio < 1.25) || left == 0) {
      return result;
    }
  }
}

std::vector<SelectedPixel> selectPatchMaxima(const Frame& frame,
                                             const RegionThresholds& thresholds,
                                             int patch_size) {
  const PyramidLevel& level = frame.level(0);
  const int end_x = level.width() - kPatternRadius - 1;
  const int end_y = level.height() - kPatternRadius - 1;
  const auto rows = static_cast<std::size_t>((level.height() + patch_size - 1) / patch_size);
  std::vector<std::vector<SelectedPixel>> selected(rows);  // by row of patches
  forEachRange(rows, kPatchRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      const int y0 = static_cast<int>(row) * patch_size;
      for (int x0 = 0; x0 < level.width(); x0 += patch_size) {
        Best best;
        for (int y = std::max(y0, kPatternRadius + 1); y < std::min(y0 + patch_size, end_y); ++y) {
          const float* squared = thresholds.squaredGradients(y);
          for (int x = std::max(x0, kPatternRadius + 1); x < std::min(x0 + patch_size, end_x);
               ++x) {
            if (squared[x] > best.score && squared[x] > thresholds.squaredThreshold(x, y)) {
              best.offer(squared[x], x, y);
            }
          }
        }
        if (best.x >= 0 && patternIsValid(level, best.x, best.y)) {
          selected[row].push_back({best.x, best.y, 1});
        }
      }
    }
  });
  std::vector<SelectedPixel> all;
  for (const std::vector<SelectedPixel>& row : selected) {
    all.insert(all.end(), row.begin(), row.end());
  }
  return all;
}

}  // namespace dsorb
