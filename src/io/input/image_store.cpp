// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "io/input/image_decoder.h"
#include "io/input/image_source.h"
#include "io/text_file.h"

#include <zip.h>

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

bool isImage(const fs::path& name) {
  const std::string file = name.filename().string();
  return !file.empty() && file.front() != '.' && hasImageSuffix(name);
}

/// Whether a file would be read if it lay beside the images.
bool isBesideImages(const fs::path& name) {
  const std::string file = name.filename().string();
  return file == "camera.txt" || file == "times.txt" || file == "pcalib.txt";
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
bool countsBefore(std::string_view left, std::string_view right) {
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

/// The same of files, whose suffix counts last: image.png comes before "image 2.png".
bool comesBefore(const std::string& left, const std::string& right) {
  const std::string_view l = std::string_view(left).substr(0, left.rfind('.'));
  const std::string_view r = std::string_view(right).substr(0, right.rfind('.'));
  return l == r ? left < right : countsBefore(l, r);
}

bool isNumbered(const fs::path& name) {
  const std::string stem = name.stem().string();
  return std::any_of(stem.begin(), stem.end(), isDigit);
}

/// Whether an image without a number begins those that have one: `image.png`, `image 2.png`.
bool begins(const fs::path& name, const std::vector<std::string>& others) {
  const std::string stem = name.stem().string();
  return std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
    return isNumbered(other) && other.stem().string().compare(0, stem.size(), stem) == 0;
  });
}

/// Takes out what is no image of the sequence: files that have another use, and images without a
/// number among numbered ones (vignette.png, mask.png, cover.jpg). @return them
std::vector<std::string> takeAccessories(const std::vector<fs::path>& others,
                                         std::vector<std::string>& names) {
  const bool numbered = std::any_of(
      names.begin(), names.end(), [](const fs::path& name) { return isNumbered(name); });
  const auto is_accessory = [&](const fs::path& file) {
    std::error_code error;
    const bool used = std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
      return other.filename() == file.filename() && fs::equivalent(other, file, error);
    });
    return used || (numbered && !isNumbered(file) && !begins(file, names));
  };
  std::vector<std::string> images;
  std::vector<std::string> accessories;
  for (std::string& name : names) {
    (is_accessory(name) ? accessories : images).push_back(name);
  }
  names = std::move(images);
  return accessories;
}

struct CloseArchive {
  void operator()(zip_t* archive) const {
    if (archive != nullptr) zip_discard(archive);
  }
};
struct CloseEntry {
  void operator()(zip_file_t* entry) const { zip_fclose(entry); }
};

/// The images in the order of their names, without what is none of the sequence.
/// @param left_out files that are left out beside these
std::unique_ptr<ImageStore> inOrder(std::vector<std::string> names,
                                    const std::vector<fs::path>& others,
                                    const std::vector<std::string>& left_out,
                                    ImageStore::Read read) {
  std::vector<std::string> accessories = takeAccessories(others, names);
  accessories.insert(accessories.end(), left_out.begin(), left_out.end());
  std::sort(names.begin(), names.end(), comesBefore);
  return std::make_unique<ImageStore>(std::move(names), std::move(accessories), std::move(read));
}

/// An image of an archive.
struct ArchiveEntry {
  zip_uint64_t position;
  zip_uint64_t bytes;
};

std::vector<std::uint8_t> readEntry(zip_t* archive,
                                    const ArchiveEntry& entry,
                                    const std::string& name) {
  if (entry.bytes > kMaxImageBytes) {
    throw fileError(name, "{} MiB are too many for an image", entry.bytes >> 20U);
  }
  const std::unique_ptr<zip_file_t, CloseEntry> file(zip_fopen_index(archive, entry.position, 0));
  std::vector<std::uint8_t> bytes(entry.bytes);
  if (file && zip_fread(file.get(), bytes.data(), bytes.size()) == std::int64_t(bytes.size())) {
    return bytes;
  }
  throw fileError(name, "cannot be read from the archive");
}

std::unique_ptr<ImageStore> openArchive(const fs::path& path) {
  int code = 0;
  const std::shared_ptr<zip_t> archive(zip_open(path.c_str(), ZIP_RDONLY, &code), CloseArchive());
  if (!archive) throw fileError(path, "no readable zip archive");
  std::map<std::string, ArchiveEntry> entries;
  std::vector<std::string> names;
  std::vector<std::string> unread;
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    zip_stat_t entry;
    const auto position = static_cast<zip_uint64_t>(i);
    if (zip_stat_index(archive.get(), position, 0, &entry) != 0) {
      throw fileError(path, "entry {} cannot be read", i);
    }
    const std::string name = (path / entry.name).string();
    if (isImage(name)) {
      if (entries.emplace(name, ArchiveEntry{position, entry.size}).second) names.push_back(name);
    } else if (isBesideImages(name)) {
      unread.push_back(name);
    }
  }
  return inOrder(std::move(names), {}, unread, [archive, entries](const std::string& name) {
    return readEntry(archive.get(), entries.at(name), name);
  });
}

fs::directory_iterator contents(const fs::path& folder) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) throw fileError(folder, "cannot be opened: {}", error.message());
  return entries;
}

std::unique_ptr<ImageStore> openFolder(const fs::path& folder,
                                       const std::vector<fs::path>& others) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : contents(folder)) {
    if (isImage(entry.path()) && entry.is_regular_file()) names.push_back(entry.path().string());
  }
  return inOrder(std::move(names), others, {}, readFile);
}

}  // namespace

std::optional<SourceImage> ImageStore::image(int index) {
  return SourceImage{index, decodeGrey(read_(name(index)), name(index)), std::nullopt, {}};
}

std::unique_ptr<ImageStore> openImageList(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  names.reserve(files.size());
  for (const fs::path& file : files) names.push_back(file.string());
  return std::make_unique<ImageStore>(
      std::move(names), std::vector<std::string>(), ImageStore::Read(readFile));
}

std::unique_ptr<ImageStore> openImageStore(const fs::path& path,
                                           const std::vector<fs::path>& others) {
  auto images = fs::is_directory(path) ? openFolder(path, others) : openArchive(path);
  if (images->size() == 0) throw fileError(path, "holds no images");
  return images;
}

bool holdsImages(const fs::path& folder) {
  const auto entries = contents(folder);
  return std::any_of(begin(entries), end(entries), [](const fs::directory_entry& entry) {
    return isImage(entry.path()) && entry.is_regular_file();
  });
}

}  // namespace dsorb
