// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_store.h"

#include "dsorb/error.h"

#include "io/input/image_decoder.h"
#include "io/input/image_header.h"

#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr zip_uint64_t kFirstBlock = 1 << 20;  // of an image that is read [byte]
constexpr zip_uint64_t kMostBytesBesidePixels = 1 << 26;
constexpr zip_uint64_t kMostBytesPerPixel = 16;

// Beside the images of a sequence, by the habits of DSO, TUM-mono and of this program.
constexpr std::array<std::string_view, 4> kAccessories = {
    "vignette", "vignettesmoothed", "smoothedvignette", "mask"};

bool isImage(const fs::path& name) {
  const std::string file = name.filename().string();
  return !file.empty() && file.front() != '.' && hasImageSuffix(name);
}

std::string lowerStem(const fs::path& name) {
  std::string stem = name.stem().string();
  std::transform(stem.begin(), stem.end(), stem.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return stem;
}

/// Leaves out the images that are none of the sequence; their names go to `left_out`.
void leaveOutAccessories(const std::vector<fs::path>& others,
                         std::vector<std::string>& names,
                         std::vector<std::string>& left_out) {
  const auto known = [&](const fs::path& file) {
    std::error_code error;
    const bool named = std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
      return other.filename() == file.filename() && fs::equivalent(other, file, error);
    });
    const std::string stem = lowerStem(file);
    return named || std::find(begin(kAccessories), end(kAccessories), stem) != end(kAccessories);
  };
  const auto end = std::stable_partition(
      names.begin(), names.end(), [&](const std::string& name) { return !known(name); });
  left_out.assign(end, names.end());
  names.erase(end, names.end());
}

bool isDigit(char c) {
  return c >= '0' && c <= '9';
}

/// The digits that begin at a position, which moves behind them.
std::string_view takeDigits(std::string_view name, std::size_t& position) {
  const std::size_t begin = position;
  while (position < name.size() && isDigit(name[position])) ++position;
  return name.substr(begin, position - begin);
}

std::string_view withoutLeadingZeros(std::string_view digits) {
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

/// Orders names as people count: 2.png comes before 10.png, and 1.25.png before 1.5.png.
bool countsBefore(const std::string& left, const std::string& right) {
  std::size_t l = 0;
  std::size_t r = 0;
  while (l < left.size() && r < right.size()) {
    if (!isDigit(left[l]) || !isDigit(right[r])) {
      if (left[l] != right[r]) return left[l] < right[r];
      ++l;
      ++r;
      continue;
    }
    const bool fraction = l > 1 && left[l - 1] == '.' && isDigit(left[l - 2]);
    std::string_view a = takeDigits(left, l);
    std::string_view b = takeDigits(right, r);
    if (!fraction) {
      a = withoutLeadingZeros(a);
      b = withoutLeadingZeros(b);
      if (a.size() != b.size()) return a.size() < b.size();
    }
    if (a != b) return a < b;
  }
  if (l < left.size() || r < right.size()) return l == left.size();
  return left < right;  // they differ by leading zeros
}

class ImageFiles : public ImageStore {
 public:
  explicit ImageFiles(std::vector<std::string> names) : ImageStore(std::move(names)) {}
  [[nodiscard]] std::vector<std::uint8_t> read(int index) override { return readFile(name(index)); }
};

struct CloseArchive {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct CloseEntry {
  void operator()(zip_file_t* entry) const { zip_fclose(entry); }
};
using Archive = std::unique_ptr<zip_t, CloseArchive>;

struct ArchiveEntry {
  std::string name;
  zip_uint64_t position;
  zip_uint64_t bytes;
};

class ZippedImages : public ImageStore {
 public:
  ZippedImages(Archive archive, const fs::path& path, std::vector<ArchiveEntry> entries)
      : ImageStore(namesOf(path, entries)),
        archive_(std::move(archive)),
        entries_(std::move(entries)) {}

  [[nodiscard]] std::vector<std::uint8_t> read(int index) override {
    const ArchiveEntry& entry = entries_[static_cast<std::size_t>(index)];
    if (entry.bytes > kMaxImageBytes) {
      throw IoError(
          fmt::format("{}: {} MiB are too many for an image", name(index), entry.bytes >> 20U));
    }
    const std::unique_ptr<zip_file_t, CloseEntry> file(
        zip_fopen_index(archive_.get(), entry.position, 0));
    // The blocks double, because what an entry claims to hold may not be there.
    std::vector<std::uint8_t> bytes;
    for (zip_uint64_t done = 0; file && done < entry.bytes;) {
      bytes.resize(std::min(entry.bytes, std::max(2 * done, kFirstBlock)));
      const zip_int64_t count = zip_fread(file.get(), bytes.data() + done, bytes.size() - done);
      if (count <= 0) break;
      if (done == 0) refuseImplausible(bytes, entry.bytes, name(index));
      done += static_cast<zip_uint64_t>(count);
      if (done == entry.bytes) return bytes;
    }
    throw IoError(fmt::format("{}: cannot be read from the archive", name(index)));
  }

 private:
  /// A few bytes of an archive can claim to be many: what their beginning says of the image bounds
  /// them. @param bytes the first block
  static void refuseImplausible(const std::vector<std::uint8_t>& bytes,
                                zip_uint64_t claimed,
                                const std::string& name) {
    const cv::Size size = sizeInHeader(bytes).value_or(cv::Size());
    const auto pixels = static_cast<zip_uint64_t>(std::int64_t{size.width} * size.height);
    if (claimed <= kMostBytesPerPixel * pixels + kMostBytesBesidePixels) return;
    throw IoError(fmt::format("{}: {} MiB in the archive are too many for an image of {}x{} px",
                              name,
                              claimed >> 20U,
                              size.width,
                              size.height));
  }
  static std::vector<std::string> namesOf(const fs::path& path,
                                          const std::vector<ArchiveEntry>& entries) {
    std::vector<std::string> names;
    names.reserve(entries.size());
    for (const ArchiveEntry& entry : entries) names.push_back((path / entry.name).string());
    return names;
  }

  Archive archive_;
  std::vector<ArchiveEntry> entries_;
};

std::unique_ptr<ImageStore> openArchive(const fs::path& path) {
  int code = 0;
  Archive archive(zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (!archive) throw IoError(fmt::format("{}: no readable zip archive", path.string()));
  std::vector<ArchiveEntry> entries;
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    zip_stat_t entry;
    const auto position = static_cast<zip_uint64_t>(i);
    if (zip_stat_index(archive.get(), position, 0, &entry) != 0) {
      throw IoError(fmt::format("{}: entry {} cannot be read", path.string(), i));
    }
    if (isImage(entry.name)) entries.push_back({entry.name, position, entry.size});
  }
  std::sort(entries.begin(), entries.end(), [](const ArchiveEntry& l, const ArchiveEntry& r) {
    return countsBefore(l.name, r.name);
  });
  return std::make_unique<ZippedImages>(std::move(archive), path, std::move(entries));
}

fs::directory_iterator contents(const fs::path& folder) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) {
    throw IoError(fmt::format("{}: cannot be opened: {}", folder.string(), error.message()));
  }
  return entries;
}

std::unique_ptr<ImageStore> openFolder(const fs::path& folder,
                                       const std::vector<fs::path>& others) {
  std::vector<std::string> names;
  std::vector<std::string> left_out;
  for (const fs::directory_entry& entry : contents(folder)) {
    if (isImage(entry.path()) && entry.is_regular_file()) names.push_back(entry.path().string());
  }
  leaveOutAccessories(others, names, left_out);
  std::sort(names.begin(), names.end(), countsBefore);
  auto images = std::make_unique<ImageFiles>(std::move(names));
  images->setLeftOut(std::move(left_out));
  return images;
}

}  // namespace

IoError wrongSize(const std::string& name, cv::Size size, cv::Size expected) {
  return IoError(fmt::format("{}: {}x{} px; expected {}x{} as calibrated",
                             name,
                             size.width,
                             size.height,
                             expected.width,
                             expected.height));
}

std::optional<SourceImage> ImageStore::image(int index) {
  const std::vector<std::uint8_t> bytes = read(index);
  if (!expected_.empty()) {  // before memory is taken for it
    const cv::Size size = sizeInHeader(bytes).value_or(expected_);
    if (size != expected_) throw wrongSize(name(index), size, expected_);
  }
  return SourceImage{index, decodeGrey(bytes, name(index)), std::nullopt, {}};
}

std::unique_ptr<ImageStore> openImageList(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  names.reserve(files.size());
  for (const fs::path& file : files) names.push_back(file.string());
  return std::make_unique<ImageFiles>(std::move(names));
}

std::unique_ptr<ImageStore> openImageStore(const fs::path& path,
                                           const std::vector<fs::path>& others) {
  auto images = fs::is_directory(path) ? openFolder(path, others) : openArchive(path);
  if (images->size() == 0) throw IoError(fmt::format("{}: holds no images", path.string()));
  return images;
}

bool holdsImages(const fs::path& folder) {
  const auto entries = contents(folder);
  return std::any_of(begin(entries), end(entries), [](const fs::directory_entry& entry) {
    return isImage(entry.path()) && entry.is_regular_file();
  });
}

}  // namespace dsorb
